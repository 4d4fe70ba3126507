"""``python evaluate.py``: score a skill on labeled frames."""

import csv
import json
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from geoskill.cli.command import run_command
from geoskill.errors import InputError


def main() -> None:
    """Entry point of ``evaluate.py`` and ``geoskill-evaluate``."""
    run_command("evaluate", evaluate)


def evaluate(cfg: DictConfig) -> None:
    """Write ``metrics.json`` and the verdict of every judged frame.

    Raises:
        InputError: for an unusable skill, video or regions file.
    """
    from geoskill.cli.footage import demonstration_recording, simulated_footage, stored_seed, video_footage
    from geoskill.cli.inputs import array_store, load_skill, open_recording, require_selection, required
    from geoskill.cli.progress import quiet_libraries
    from geoskill.cli.scoring import score, score_oracle
    from geoskill.evaluation.metrics import summarize_ensemble
    from geoskill.io.atomic import atomic_open

    quiet_libraries()
    simulated = "task" in cfg and cfg.task is not None
    if simulated and not (cfg.video is None and cfg.regions is None):
        raise InputError("task and video are both set; expected a simulated task, or video=… regions=…")
    if simulated and "scene" not in cfg.task:
        raise InputError("task=video is no simulated task; expected one such as task=sorting, or video=… regions=…")
    if not simulated:
        required(cfg, "video", "a labeled video file or folder of images, or task=… for a simulated one")
        required(cfg, "regions", "a JSON file of labeled regions")
    if cfg.every < 1:
        raise InputError(f"every={cfg.every}: expected at least 1")
    require_selection(cfg.inference)
    skill = load_skill(cfg)
    choices, store = HydraConfig.get().runtime.choices, array_store(cfg)
    if simulated:
        seed = stored_seed(skill.learned_from) if cfg.seed is None else cfg.seed
        footage = simulated_footage(cfg.task, cfg.scenario, seed, choices["scenario"], store)
    else:
        footage = video_footage(open_recording(cfg.video, cfg.frame_rate), cfg.regions, cfg.every, minimum=1)
    assert footage.labels is not None
    figures, rows = score(skill, footage.frames, footage.labels, cfg.every, cfg.inference)
    if footage.recording is not None:
        from geoskill.evaluation.baseline import track_hand_picked_pairs

        baseline = track_hand_picked_pairs(footage.recording)
        figures |= {"baseline_success": baseline.success, "baseline_pairs": [baseline.kept, baseline.picked]}
        demonstrated = demonstration_recording(skill.learned_from, cfg.task, choices["task"], store)
        if demonstrated is not None:
            for name, bound in score_oracle(skill, demonstrated, footage.recording).items():
                figures["members"][name] |= bound
            figures |= summarize_ensemble(figures["members"])
    folder = Path(HydraConfig.get().runtime.output_dir)
    with atomic_open(folder / "metrics.json") as file:
        json.dump(
            {"skill": str(cfg.skill), "video": footage.source.name, "every": cfg.every, **figures}, file, indent=2
        )
    with atomic_open(folder / "verdicts.csv") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    for name, member in figures["members"].items():
        accuracy = member["top1_accuracy"]
        print(
            f"{name}: top-1 accuracy {'none' if accuracy is None else f'{accuracy:.3f}'}"
            f" on {member['feasible_frames']} of {member['frames']} frames, RSW {member['rsw']:.4f}"
        )
    if figures["unlabeled_frames"]:
        print(f"{figures['unlabeled_frames']} frames to be judged have no labels and were left out")
    print(folder)


if __name__ == "__main__":
    main()
