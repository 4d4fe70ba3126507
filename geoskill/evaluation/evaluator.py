"""Evaluation of a skill on the labeled frames of a sequence."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from geoskill.errors import InputError
from geoskill.evaluation.labels import Labels
from geoskill.evaluation.metrics import FrameResult, evaluate_frame, summarize, summarize_ensemble, top_association
from geoskill.evaluation.switches import SwitchCounter
from geoskill.io.frames import Frame
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import InferenceResult

Infer = Callable[..., InferenceResult]
"""From an RGB frame, and where it has depth, None and its depth, to what is selected in it."""
Progress = Callable[[Iterable[Frame]], Iterable[Frame]]
Watch = Callable[[Frame, InferenceResult, Sequence[FrameResult]], None]


def silent(frames: Iterable[Frame]) -> Iterable[Frame]:
    """Return the frames themselves: the progress display that shows nothing."""
    return frames


def evaluate_frames(
    frames: Iterable[Frame],
    infer: Infer,
    labels: Labels,
    members: Mapping[str, KernelModel],
    every: int = 1,
    continuous: bool = False,
    progress: Progress = silent,
    watch: Watch | None = None,
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Evaluate a skill's top associations on labeled frames, with at most two frames in memory at a time.

    Args:
        frames: all frames of the sequence, in order, from its first.
        infer: returns the skill's result on an RGB frame.
        labels: ground truth. Frames before the first and after the last labeled one are left out.
        members: members of the skill, by the name that they have in its associations.
        every: evaluate frames 0, every, 2 * every, ... only. A transition is then from one evaluated frame to the next,
            and nodes are tracked through the frames in between.
        continuous: whether ``infer`` depends on the previous frames, and so has to see the frames in between too.
        progress: shows progress over the frames.
        watch: is shown every evaluated frame, what was selected in it, and the results of all members; or None.

    Returns:
        The metrics (see :func:`~geoskill.evaluation.metrics.summarize_ensemble`), with the number of frames left out
        for want of labels as ``unlabeled_frames``; and one row for each evaluated frame and member: the frame result
        and ``switched``, None when the transition from the previously evaluated frame is not comparable. Plain types
        only.

    Raises:
        InputError: when ``every`` is below 1, the size of the frames is not that of the labels, or none of the frames
            to evaluate is labeled.
        ValueError: without members, or when the skill's results lack their features.
    """
    if every < 1:
        raise InputError(f"every={every}: expected at least 1")
    if not members:
        raise ValueError("there are no members; expected at least one")
    frame_results: dict[str, list[FrameResult]] = {name: [] for name in members}
    counters = {name: SwitchCounter(member.kernel) for name, member in members.items()}
    rows: list[dict[str, Any]] = []
    num_frames = unlabeled = 0
    for frame in progress(frames):
        if num_frames == 0:
            labels.require_size((frame.image.shape[1], frame.image.shape[0]))
        num_frames += 1
        ground_truth = labels.at(frame.index)
        if ground_truth is None:
            unlabeled += frame.index % every == 0
            continue
        for counter in counters.values():
            counter.advance(frame.image)
        evaluated = frame.index % every == 0
        if evaluated or continuous:
            result = infer(frame.image) if frame.depth is None else infer(frame.image, None, frame.depth)
        if not evaluated:
            continue
        own: list[FrameResult] = []
        for name, member in members.items():
            frame_result = evaluate_frame(frame.index, result, ground_truth, name, member)
            own.append(frame_result)
            switched = counters[name].evaluate(top_association(result, name))
            frame_results[name].append(frame_result)
            rows.append(_row(frame_result, member, switched))
        if watch is not None:
            watch(frame, result, own)
    labels.require_evaluated(num_frames, every)
    metrics = {name: summarize(frame_results[name], counters[name].count) for name in members}
    return {**summarize_ensemble(metrics), "unlabeled_frames": unlabeled}, rows


def _row(frame_result: FrameResult, member: KernelModel, switched: bool | None) -> dict[str, Any]:
    error_m = None if frame_result.goal is None else frame_result.goal.error_m
    return {
        "frame": frame_result.frame,
        "kernel": member.kernel.name,
        "descriptor": member.descriptor,
        "has_association": frame_result.has_association,
        "feasible": frame_result.feasible,
        "correct": frame_result.correct,
        "hits_hand": frame_result.hits_hand,
        "strict": frame_result.strict,
        "goal_error_mm": None if error_m is None else 1000 * error_m,
        "confidence": frame_result.confidence,
        "rsw": frame_result.rsw,
        "switched": switched,
    }
