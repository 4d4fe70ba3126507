"""Scoring a skill on the labeled frames of a real sequence."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.evaluation.labels import Labels
from geoskill.evaluation.metrics import FrameVerdict, judge_frame, summarize, summarize_ensemble, top_association
from geoskill.evaluation.switches import SwitchCounter
from geoskill.io.frames import Frame
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import InferenceResult

Infer = Callable[[UInt8[np.ndarray, "height width 3"]], InferenceResult]
Progress = Callable[[Iterable[Frame]], Iterable[Frame]]


def silent(frames: Iterable[Frame]) -> Iterable[Frame]:
    """The progress display that shows nothing."""
    return frames


def member_name(kernel: Kernel, descriptor: str) -> str:
    """What a member of an ensemble is called in ``metrics.json``, such as ``p2p/sift`` or ``p2l/sift+lbd``."""
    return f"{kernel.name}/{descriptor}"


def evaluate_frames(
    frames: Iterable[Frame],
    infer: Infer,
    regions: Labels,
    members: Sequence[tuple[Kernel, str]],
    every: int = 1,
    continuous: bool = False,
    progress: Progress = silent,
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Judges a skill's top associations on labeled frames; no more than two frames are in memory at a time.

    Args:
        frames: all frames of the sequence, in order, from its first.
        infer: the skill.
        regions: the ground truth. Frames before its first and after its last labeled one are left out.
        members: kernel and descriptor of each member of the ensemble, as they stand in its associations.
        every: judge frames 0, every, 2 * every, ... only. A transition is then from one judged frame to the next, and
            nodes are followed through the frames in between.
        continuous: whether ``infer`` has to be shown the frames in between as well, since it remembers.
        progress: shows progress over the frames.

    Returns:
        The figures (see :func:`~geoskill.evaluation.metrics.summarize_ensemble`; besides these ``unlabeled_frames``,
        the number that was left out for want of labels) and, for each judged frame and member, one row: the verdict
        and ``switched``, None where the transition from the frame judged before is not comparable. Plain types only.

    Raises:
        InputError: when ``every`` is below 1, the frames are not of the size that was labeled, or none of
            those to be judged is labeled.
    """
    if every < 1:
        raise InputError(f"every={every}: expected at least 1")
    names = [member_name(kernel, descriptor) for kernel, descriptor in members]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"members are {names}; expected at least one and each once")
    verdicts: dict[str, list[FrameVerdict]] = {name: [] for name in names}
    counters = {name: SwitchCounter(kernel) for name, (kernel, _) in zip(names, members, strict=True)}
    rows: list[dict[str, Any]] = []
    seen = unlabeled = 0
    for frame in progress(frames):
        if seen == 0:
            regions.require_size((frame.image.shape[1], frame.image.shape[0]))
        seen += 1
        truth = regions.at(frame.index)
        if truth is None:
            unlabeled += frame.index % every == 0
            continue
        for counter in counters.values():
            counter.advance(frame.image)
        judged = frame.index % every == 0
        if judged or continuous:
            result = infer(frame.image)
        if not judged:
            continue
        for name, (kernel, descriptor) in zip(names, members, strict=True):
            verdict = judge_frame(frame.index, result, truth, kernel, descriptor)
            switched = counters[name].judge(top_association(result, kernel, descriptor))
            verdicts[name].append(verdict)
            rows.append(_row(verdict, kernel, descriptor, switched))
    regions.require_judged(seen, every)
    figures = {name: summarize(verdicts[name], counters[name].count) for name in names}
    return {**summarize_ensemble(figures), "unlabeled_frames": unlabeled}, rows


def _row(verdict: FrameVerdict, kernel: Kernel, descriptor: str, switched: bool | None) -> dict[str, Any]:
    return {
        "frame": verdict.frame,
        "kernel": kernel.name,
        "descriptor": descriptor,
        "has_association": verdict.has_association,
        "feasible": verdict.feasible,
        "correct": verdict.correct,
        "hits_hand": verdict.hits_hand,
        "strict": verdict.strict,
        "goal_error_mm": None if verdict.goal is None or verdict.goal.error_m is None else 1000 * verdict.goal.error_m,
        "confidence": verdict.confidence,
        "rsw": verdict.rsw,
        "switched": switched,
    }
