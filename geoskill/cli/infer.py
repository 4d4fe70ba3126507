"""``python infer.py``: select associations on every frame of a video, a folder or a camera."""

from geoskill.cli.command import Run, let_idle_threads_sleep, run_command
from geoskill.cli.schemas import InferCommandConfig


def main() -> None:
    """Run ``infer.py`` or ``geoskill-infer``."""
    run_command("infer", InferCommandConfig, infer)


def infer(config: InferCommandConfig, run: Run) -> None:
    """Write what a skill says about every frame.

    Raises:
        InputError: for an unusable skill or video.
    """
    let_idle_threads_sleep()
    from geoskill.cli.inputs import load_skill, open_disk_cache, required, selection, use_threads
    from geoskill.cli.report import report_inference
    from geoskill.cli.reporting import write_inference
    from geoskill.io.sources import open_frames
    from geoskill.training.quiet import quiet_libraries

    with quiet_libraries():
        threads = use_threads(config.threads)
        video = required("video", config.video, "a video file, a folder of images or a camera's number")
        store = open_disk_cache(config.cache)
        skill = load_skill(config.skill, config.device, config.precision, store, config.definition)
        source = open_frames(str(video), config.frame_rate)
        infer_next = selection(skill, config.inference)
        write_inference(skill, infer_next, source, source, run.folder, config.inference.min_drawn_weight, {}, threads)
        if config.report:
            report_inference(run, skill, str(config.skill))
    print(run.folder)


if __name__ == "__main__":
    main()
