"""Scoring a skill on labeled frames, for the commands that do it."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8

from geoskill.cli.inputs import selection
from geoskill.cli.progress import show_progress
from geoskill.cli.reporting import association_lines
from geoskill.cli.schemas import RegionsConfig
from geoskill.config import SelectionConfig
from geoskill.errors import InputError
from geoskill.evaluation.annotations.assignment import RoleNames
from geoskill.evaluation.annotations.load import load_regions
from geoskill.evaluation.evaluator import Watch, evaluate_frames
from geoskill.evaluation.labels import Labels
from geoskill.evaluation.regions import Regions
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.io.frames import Frame
from geoskill.io.prefetch import prefetch_map
from geoskill.skill.association import InferenceResult
from geoskill.skill.skill import Skill

if TYPE_CHECKING:
    from geoskill.simulation.recording import Recording


def load_labels(config: RegionsConfig, frames: Sequence[Frame], every: int, stems: Sequence[str] | None) -> Regions:
    """Read the labeled regions of these frames, every so many of which are evaluated.

    Args:
        config: where they are and what their labels are.
        frames: of the recording.
        every: so many frames lie between two that are evaluated.
        stems: names of the recording's pictures; see :func:`~geoskill.evaluation.annotations.load.load_regions`.

    Raises:
        InputError: when the regions do not fit the frames, or cover none that is evaluated.
    """
    if every < 1:
        raise InputError(f"every={every}: expected at least 1")
    height, width = frames[0].image.shape[:2]
    assert config.path is not None
    names = RoleNames(config.object, config.target, config.hand)
    regions = load_regions(config.path, (width, height), len(frames), names, stems)
    regions.require_evaluated(len(frames), every)
    return regions


def score(
    skill: Skill,
    frames: Sequence[Frame],
    labels: Labels,
    every: int,
    config: SelectionConfig,
    selected: list[dict[str, Any]] | None = None,
    threads: int = 1,
    watch: Watch | None = None,
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Return metrics over all evaluated frames, and a row for each member and evaluated frame.

    Args:
        skill: selects the associations.
        frames: of the recording.
        labels: ground truth.
        every: so many frames lie between two that are evaluated.
        config: of the selection.
        selected: takes in what ``associations.jsonl`` would say of the top associations; None where nobody wants it.
        threads: number of frames whose features are extracted at once, ahead of their use; the result does not depend
            on it.
        watch: see :func:`~geoskill.evaluation.evaluator.evaluate_frames`.

    Raises:
        InputError: when no evaluated frame is labeled.
    """
    continuous = config.temporal != "none"
    infer = selection(skill, config)
    ready: dict[str, FeatureSet] | None = None
    current: Frame | None = None

    def extract(frame: Frame) -> tuple[Frame, dict[str, FeatureSet] | None]:
        needed = (continuous or frame.index % every == 0) and labels.at(frame.index) is not None
        return frame, skill.extract(frame.image, frame.depth) if needed else None

    def noted(
        image: UInt8[np.ndarray, "height width 3"], _features: None = None, depth: DepthPicture | None = None
    ) -> InferenceResult:
        result = infer(image, ready, depth)
        if selected is not None and current is not None:
            selected.extend(line for line in association_lines(current, result, skill.members) if line["rank"] <= 1)
        return result

    with closing(prefetch_map(extract, frames, threads=threads)) as extracted:

        def in_turn() -> Iterator[Frame]:
            nonlocal ready, current
            for current, ready in extracted:  # noqa: B007  # used by what infers, frame by frame
                yield current

        return evaluate_frames(
            in_turn(),
            noted,
            labels,
            skill.members,
            every=every,
            continuous=continuous,
            progress=lambda items: show_progress(items, "evaluating frames", total=len(frames)),
            watch=watch,
        )


def score_oracle(
    skill: Skill, demonstration: "Recording", frames: Mapping[int, Frame], recording: "Recording"
) -> dict[str, dict[str, Any]]:
    """Return the metrics of an oracle for each member.

    The oracle knows all pairs that meet in the demonstration's picture; a skill that learned from it cannot be expected
    to be more exact in another recording.

    Args:
        skill: the skill.
        demonstration: that it learned from.
        frames: some of the demonstration's frames by number, with depth if the skill needs it.
        recording: the other one.
    """
    from geoskill.evaluation.oracle import evaluate_oracle

    found = {
        name: {number: pipeline.extract(frame.image, frame.depth) for number, frame in frames.items()}
        for name, pipeline in skill.pipelines.items()
    }
    return {
        member_name: evaluate_oracle(
            member.kernel,
            demonstration,
            {frame: {kind: found[name][frame] for kind, name in member.extractors.items()} for frame in frames},
            recording,
        )
        for member_name, member in skill.members.items()
    }
