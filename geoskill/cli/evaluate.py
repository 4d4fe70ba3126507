"""``python evaluate.py``: score a skill on labeled frames."""

import csv
import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from geoskill.cli.command import Run, run_command
from geoskill.cli.schemas import EvaluateCommandConfig, SimulatedTaskConfig
from geoskill.errors import InputError

if TYPE_CHECKING:
    from geoskill.cli.sequences import LabeledSequence
    from geoskill.evaluation.metrics import FrameResult
    from geoskill.io.disk_cache import DiskCache
    from geoskill.io.frames import Frame
    from geoskill.skill.association import InferenceResult
    from geoskill.skill.skill import Skill

# Frames of a demonstration in whose features the oracle looks for associations that meet.
ORACLE_FRAMES = 12


def main() -> None:
    """Run ``evaluate.py`` or ``geoskill-evaluate``."""
    run_command("evaluate", EvaluateCommandConfig, evaluate)


def evaluate(config: EvaluateCommandConfig, run: Run) -> None:
    """Write ``metrics.json``, and the result of every evaluated frame.

    Raises:
        InputError: for an unusable skill, video or regions file.
    """
    from geoskill.cli.end_of_task import EndOfTask
    from geoskill.cli.failure_pictures import FailurePictures
    from geoskill.cli.inputs import load_skill, open_disk_cache, required, use_threads
    from geoskill.cli.report import report_evaluation
    from geoskill.cli.scoring import score
    from geoskill.io.atomic import atomic_open
    from geoskill.training.quiet import quiet_libraries

    if config.task is not None and not (config.video is None and config.regions.path is None):
        raise InputError("task and video are both set; expected a simulated task, or video=… regions=…")
    if config.task is not None and not isinstance(config.task, SimulatedTaskConfig):
        raise InputError("task=video is no simulated task; expected one such as task=sorting, or video=… regions=…")
    if config.task is None:
        required("video", config.video, "a labeled video file or folder of images, or task=… for a simulated one")
        required("regions", config.regions.path, "a file or folder of labeled regions")
    with quiet_libraries():
        threads = use_threads(config.threads)
        store = open_disk_cache(config.cache)
        skill = load_skill(config.skill, config.device, config.precision, store, config.definition)
        sequence = _sequence(config, run, skill, store)
        assert sequence.labels is not None
        selected: list[dict[str, Any]] = []
        failures, end = FailurePictures(sequence.labels, config.failures), EndOfTask()

        def watch(frame: "Frame", result: "InferenceResult", results: "Sequence[FrameResult]") -> None:
            failures(frame, result, results)
            end.add(frame, result)

        metrics, rows = score(
            skill, sequence.frames, sequence.labels, config.every, config.inference, selected, threads, watch
        )
        if sequence.recording is not None:
            metrics = _beside_simulation(metrics, config, skill, sequence, store)
        metrics["decidability"] = end.decidability(skill)
    with atomic_open(run.folder / "metrics.json") as file:
        described = {"skill": str(config.skill), "video": sequence.source.name, "every": config.every}
        json.dump({**described, **metrics}, file, indent=2)
    with atomic_open(run.folder / "frames.csv") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    failures.write(run.folder)
    if config.report:
        report_evaluation(run, skill, str(config.skill), selected)
    _print_summary(config, run, metrics)


def _print_summary(config: EvaluateCommandConfig, run: Run, metrics: dict[str, Any]) -> None:
    from geoskill.cli.summary import decidability_line, print_summary, script

    lines = []
    for name, member in metrics["members"].items():
        accuracy, confidence = member["top1_accuracy"], member["mean_confidence"]
        lines.append(
            f"{name}: top-1 accuracy {'none' if accuracy is None else f'{accuracy:.3f}'}"
            f" on {member['feasible_frames']} of {member['frames']} frames, RSW {member['rsw']:.4f},"
            f" confidence {'none' if confidence is None else f'{confidence:.2f}'} on average"
        )
    decided = decidability_line(metrics)
    if decided is not None:
        lines.append(decided)
    if metrics["unlabeled_frames"]:
        lines.append(f"{metrics['unlabeled_frames']} frames to be evaluated have no labels and were left out")
    video = "VIDEO" if config.video is None else str(config.video)
    following = [f"{script('infer', f'skill={config.skill}', f'video={video}')}   # every frame, with an overlay"]
    print_summary(lines, run.folder, following)


def _sequence(config: EvaluateCommandConfig, run: Run, skill: "Skill", store: "DiskCache | None") -> "LabeledSequence":
    from geoskill.cli.inputs import open_recording
    from geoskill.cli.sequences import labeled_recording, labeled_video
    from geoskill.io.choice import Choice
    from geoskill.skill.checkpoint import SimulatedScene

    if config.task is None:
        choice = Choice(config.episode, config.camera, config.topic)
        source = open_recording(config.video, config.frame_rate, choice, strict_video=config.strict_video)
        return labeled_video(source, config.regions, config.every, minimum=1)
    demonstrated = skill.provenance.scene
    seed = config.seed if config.seed is not None else 0 if demonstrated is None else demonstrated.seed
    scene = SimulatedScene(config.task.name, seed, config.scenario)
    return labeled_recording(scene, run.choices["scenario"], store, config.task.depth)


def _beside_simulation(
    metrics: dict[str, Any],
    config: EvaluateCommandConfig,
    skill: "Skill",
    sequence: "LabeledSequence",
    store: "DiskCache | None",
) -> dict[str, Any]:
    """Return the metrics with those of the paper's trackers and of an oracle beside them."""
    from geoskill.cli.scoring import score_oracle
    from geoskill.cli.sequences import DEMONSTRATION, RecordingSource, simulated_recording
    from geoskill.evaluation.baseline import track_hand_picked_pairs
    from geoskill.evaluation.metrics import summarize_ensemble

    assert sequence.recording is not None
    baseline = track_hand_picked_pairs(sequence.recording)
    metrics = {
        **metrics,
        "baseline_success": baseline.success,
        "baseline_pairs": [baseline.kept, baseline.picked],
    }
    scene = skill.provenance.scene
    if scene is not None and scene.task == config.task.name:
        demonstrated = simulated_recording(scene, DEMONSTRATION, store)
        source = RecordingSource(
            demonstrated, DEMONSTRATION, depth=config.task.depth, seed=scene.seed, episode=DEMONSTRATION
        )
        frames = {
            number: source.frame(number)
            for number in range(0, len(demonstrated), len(demonstrated) // ORACLE_FRAMES or 1)
        }
        for name, bound in score_oracle(skill, demonstrated, frames, sequence.recording).items():
            metrics["members"][name] |= bound
        metrics |= summarize_ensemble(metrics["members"])
    return metrics


if __name__ == "__main__":
    main()
