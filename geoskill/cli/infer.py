"""``python infer.py``: select associations on every frame of a video, a folder or a camera."""

from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from geoskill.cli.command import let_idle_threads_sleep, run_command


def main() -> None:
    """Entry point of ``infer.py`` and ``geoskill-infer``."""
    run_command("infer", infer)


def infer(cfg: DictConfig) -> None:
    """Write what a skill says about every frame.

    Raises:
        InputError: for an unusable skill or video.
    """
    let_idle_threads_sleep()
    from geoskill.cli.inputs import load_skill, require_selection, required, selection, use_threads
    from geoskill.cli.progress import quiet_libraries
    from geoskill.cli.reporting import write_inference
    from geoskill.io.sources import open_frames

    quiet_libraries()
    threads = use_threads(cfg.threads)
    video = required(cfg, "video", "a video file, a folder of images or a camera's number")
    require_selection(cfg.inference)
    skill = load_skill(cfg)
    infer_next = selection(skill, cfg.inference)
    source = open_frames(str(video), cfg.frame_rate)
    folder = Path(HydraConfig.get().runtime.output_dir)
    write_inference(skill, infer_next, source, source, folder, cfg.minimum_weight, {}, threads)
    print(folder)


if __name__ == "__main__":
    main()
