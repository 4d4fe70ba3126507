"""Scoring a skill on labelled frames, for the commands that do it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.progress import track

from geoskill.evaluation.benchmark import evaluate_frames
from geoskill.evaluation.regions import load_regions
from geoskill.features.video import Frame
from geoskill.skill.skill import Skill


def score(
    skill: Skill, frames: Sequence[Frame], regions_path: str | Path, every: int
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Figures over all judged frames, and a row for each member and judged frame.

    Raises:
        InputError: when the regions do not fit the frames.
    """
    height, width = frames[0].image.shape[:2]
    regions = load_regions(Path(regions_path), (width, height), len(frames))
    return evaluate_frames(
        frames,
        skill.infer,
        regions,
        [(member.kernel, member.descriptor) for member in skill.members.values()],
        every=every,
        progress=lambda items: track(items, description="judging frames", total=len(frames), transient=True),
    )
