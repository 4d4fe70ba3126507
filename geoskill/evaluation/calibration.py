"""Calibration: how well confidence predicts whether the top association is right.

Source: Guo et al., "On Calibration of Modern Neural Networks", ICML 2017.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple, final

BINS = 10


@final
class ReliabilityBin(NamedTuple):
    """Frames of similar confidence.

    Attributes:
        frames: number of frames.
        confidence: their mean confidence; 0 without frames.
        accuracy: fraction of them whose top association is right; 0 without frames.
    """

    frames: int
    confidence: float
    accuracy: float


def reliability(outcomes: Iterable[tuple[float, bool]]) -> list[ReliabilityBin]:
    """Bin frames by confidence, in ten equal steps from 0 to 1.

    Args:
        outcomes: confidence of each frame's top association, in [0, 1], and whether the association is right.

    >>> reliability([(0.95, True), (0.97, False), (1.0, True)])[-1]
    ReliabilityBin(frames=3, confidence=0.9733333333333333, accuracy=0.6666666666666666)
    """
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(BINS)]
    for confidence, correct in outcomes:
        bins[min(int(BINS * confidence), BINS - 1)].append((confidence, correct))
    return [
        ReliabilityBin(
            len(outcomes_in_bin),
            _mean([confidence for confidence, _ in outcomes_in_bin]),
            _mean([correct for _, correct in outcomes_in_bin]),
        )
        for outcomes_in_bin in bins
    ]


def pooled(sequences: Iterable[Sequence[Sequence[float]]]) -> list[ReliabilityBin]:
    """Combine the bins of several sequences.

    Args:
        sequences: bins of each sequence, as from :func:`reliability` or as lists [frames, confidence, accuracy].
    """
    totals = [[0.0, 0.0, 0.0] for _ in range(BINS)]
    for bins in sequences:
        for total, (frames, confidence, accuracy) in zip(totals, bins, strict=True):
            total[0] += frames
            total[1] += frames * confidence
            total[2] += frames * accuracy
    return [
        ReliabilityBin(int(frames), confidence_sum / max(1.0, frames), accuracy_sum / max(1.0, frames))
        for frames, confidence_sum, accuracy_sum in totals
    ]


def expected_calibration_error(bins: Sequence[ReliabilityBin]) -> float | None:
    """Compute the mean difference between confidence and accuracy, weighted by frames; None without frames.

    >>> expected_calibration_error([ReliabilityBin(3, 0.9, 1.0), ReliabilityBin(1, 0.5, 0.0)])
    0.19999999999999998
    """
    total_frames = sum(frames for frames, _, _ in bins)
    if total_frames == 0:
        return None
    return sum(frames * abs(confidence - accuracy) for frames, confidence, accuracy in bins) / total_frames


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0
