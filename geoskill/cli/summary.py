"""The end of a command: what was found, how sure that is, the files with a line each, and what to do next."""

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from geoskill.cli.command import program

FILES: Mapping[str, str] = {
    "report.html": "one page to read: what was learned, how sure it is, the video",
    "overlay.mp4": "the video with its features and the selected associations",
    "definition": "pictures of what belongs together",
    "skill.yaml": "the task in words: what belongs to what, how surely, and the error's rows",
    "skill.ckpt": "the skill, for infer.py and evaluate.py",
    "associations.jsonl": "one line for each frame, kernel and rank: features, error, confidence",
    "inference.png": "confidence and error over the frames",
    "training.png": "objective, reward, RSW and error over the steps",
    "metrics.json": "the metrics of this run",
    "metrics.csv": "the same curves as numbers",
    "frames.csv": "the result of every frame",
    "trials.csv": "how every trial ended",
    "servo.png": "error and distance over the frames of the trials",
    "failures": "pictures of the frames where it was wrong",
    "recording.rrd": "the same for rerun: `rerun recording.rrd`",
    "servo.jsonl": "one line for each step of the loop: rows, Jacobians, twist",
    "error.mcap": "errors, Jacobians and associations for ROS 2",
    "visp_features.json": "features for ViSP",
    "mvtb.npz": "pairs of points for the Machine Vision Toolbox",
    "summary.md": "the table of all runs",
    "summary.png": "the same as a picture",
}


def files_in(folder: Path) -> list[str]:
    """Return a line for each known file of a run that is there."""
    there = [(name, meaning) for name, meaning in FILES.items() if (folder / name).exists()]
    width = max((len(name) for name, _ in there), default=0)
    return [f"  {name:<{width}}  {meaning}" for name, meaning in there]


def confidence_line(metrics: Mapping[str, Any]) -> str:
    """Return how sure a skill was of what it selected in a recording."""
    frames, selected, mean = (metrics.get(key) for key in ("frames", "frames_with_association", "mean_confidence"))
    if not selected or mean is None:
        return f"confidence: nothing is selected in any of {frames} frames"
    return f"confidence: {mean:.2f} on average; something is selected in {selected} of {frames} frames"


def accuracy_line(metrics: Mapping[str, Any]) -> str | None:
    """Return how often the best association was right, where that is known."""
    accuracy, frames = metrics.get("top1_accuracy"), metrics.get("feasible_frames")
    return None if accuracy is None else f"accuracy: {accuracy:.1%} of {frames} labeled frames (top 1)"


def decidability_line(metrics: Mapping[str, Any]) -> str | None:
    """Return what the selected associations determine by one camera, and whether that decides the task."""
    found = metrics.get("decidability")
    if found is None:
        return None
    camera = found["one_camera"]
    line = (
        f"determined by one camera, all associations together: {camera['determined']} of {camera['of']}"
        " (x, y, z, and the turn about the vertical)"
    )
    if camera["free"]:
        line += f"; free: {', '.join(camera['free'])}"
    if camera["weak"]:
        line += "; weak: " + ", ".join(
            f"{own['motion']} ({own['mm']:.0f} mm, {own['deg']:.1f}°)" for own in camera["weak"]
        )
    return f"{line}; decidable: {found['decidable']}"


def script(name: str, *arguments: str) -> str:
    """Return the command line of another command, started as this one was."""
    own = program()
    # Installed, it is geoskill-train without an interpreter.
    started = [f"geoskill-{name}"] if len(own) == 1 else ["python", str(Path(own[1]).with_name(f"{name}.py"))]
    return shlex.join([*started, *arguments])


def print_summary(found: Sequence[str], folder: Path, following: Sequence[str]) -> None:
    """Print what was found, the files and what to do next; the folder comes last, alone in its line."""
    for line in found:
        print(line)
    print("\nfiles:", *files_in(folder), sep="\n")
    if following:
        print("\nnext:", *(f"  {line}" for line in following), sep="\n")
    print(f"\n{folder}", flush=True)
