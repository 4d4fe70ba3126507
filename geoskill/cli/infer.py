"""``python infer.py``: select associations on every frame of a video, a folder or a camera."""

import sys

from geoskill.cli.command import Run, run_command
from geoskill.cli.schemas import InferCommandConfig
from geoskill.cli.videos import with_each_video


def main() -> None:
    """Run ``infer.py`` or ``geoskill-infer``."""
    sys.argv[1:] = with_each_video(sys.argv[1:])
    run_command("infer", InferCommandConfig, infer)


def infer(config: InferCommandConfig, run: Run) -> None:
    """Write what a skill says about every frame.

    Raises:
        InputError: for an unusable skill or video.
    """
    from geoskill.cli.exporting import open_frame_exports
    from geoskill.cli.inputs import load_skill, open_disk_cache, required, rerun_of, selection, use_threads
    from geoskill.cli.report import report_inference
    from geoskill.cli.reporting import write_inference
    from geoskill.cli.summary import confidence_line, decidability_line, print_summary, script
    from geoskill.exports.names import exporters_of
    from geoskill.io.choice import Choice
    from geoskill.io.sources import open_frames
    from geoskill.training.quiet import quiet_libraries

    with quiet_libraries():
        threads, rerun = use_threads(config.threads), rerun_of(config.rerun)
        exporters = exporters_of(config.export, run.folder)
        video = required("video", config.video, "a video file, a folder of images or a camera's number")
        store = open_disk_cache(config.cache)
        skill = load_skill(config.skill, config.device, config.precision, store, config.definition)
        choice = Choice(config.episode, config.camera, config.topic)
        source = open_frames(str(video), config.frame_rate, choice, strict_video=config.strict_video)
        infer_next = selection(skill, config.inference)
        drawn = config.inference.min_drawn_weight
        with open_frame_exports(skill, exporters, config.intrinsics, config.depth_m) as exports:
            metrics = write_inference(
                skill, infer_next, source, source, run.folder, drawn, {}, threads, rerun, exports if exporters else None
            )
        if config.report:
            report_inference(run, skill, str(config.skill))
    learned = [f"{name}: {evidence}" for name, evidence in skill.evidence.items()]
    following = [f"{script('evaluate', f'skill={config.skill}', f'video={video}', 'regions=LABELS')}   # with labels"]
    said = [line for line in (confidence_line(metrics), decidability_line(metrics)) if line is not None]
    print_summary([*learned, *said], run.folder, following)


if __name__ == "__main__":
    main()
