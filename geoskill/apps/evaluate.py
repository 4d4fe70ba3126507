"""``python evaluate.py``: score a skill on labelled frames."""

import csv
import json
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from geoskill.apps.command import run_command


def main() -> None:
    """Entry point of ``evaluate.py`` and ``geoskill-evaluate``."""
    run_command("evaluate", evaluate)


def evaluate(cfg: DictConfig) -> None:
    """Write ``metrics.json`` and the verdict of every judged frame.

    Raises:
        InputError: for an unusable skill, video or regions file.
    """
    from geoskill.apps.inputs import load_skill, open_recording, required
    from geoskill.apps.progress import quiet_libraries
    from geoskill.apps.reporting import replacing
    from geoskill.apps.scoring import load_labels, score
    from geoskill.features.sources import read_all

    quiet_libraries()
    video = required(cfg, "video", "a labelled video file or folder of images")
    regions_path = required(cfg, "regions", "a JSON file of labelled regions")
    skill = load_skill(cfg)
    frames = read_all(open_recording(video, cfg.frame_rate), minimum=1)
    figures, rows = score(skill, frames, load_labels(str(regions_path), frames, cfg.every), cfg.every)
    folder = Path(HydraConfig.get().runtime.output_dir)
    with replacing(folder / "metrics.json") as file:
        json.dump({"skill": str(cfg.skill), "video": str(video), "every": cfg.every, **figures}, file, indent=2)
    with replacing(folder / "verdicts.csv") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    for name, member in figures["members"].items():
        accuracy = member["top1_accuracy"]
        print(
            f"{name}: top-1 accuracy {'none' if accuracy is None else f'{accuracy:.3f}'}"
            f" on {member['feasible_frames']} of {member['frames']} frames, RSW {member['rsw']:.4f}"
        )
    print(folder)


if __name__ == "__main__":
    main()
