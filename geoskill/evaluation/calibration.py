"""Whether a skill is right as often as it is confident.

Source of the measure: Guo et al., "On Calibration of Modern Neural Networks", ICML 2017.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple, final

BINS = 10


@final
class ReliabilityBin(NamedTuple):
    """Frames of about the same confidence.

    Attributes:
        frames: how many.
        confidence: their mean confidence; 0 without any.
        accuracy: the share of them whose top association is right; 0 without any.
    """

    frames: int
    confidence: float
    accuracy: float


def reliability(judged: Iterable[tuple[float, bool]]) -> list[ReliabilityBin]:
    """Frames by confidence, in ten equal steps from 0 to 1.

    Args:
        judged: of each frame the confidence, in [0, 1], and whether its association is right.

    >>> reliability([(0.95, True), (0.97, False), (1.0, True)])[-1]
    ReliabilityBin(frames=3, confidence=0.9733333333333333, accuracy=0.6666666666666666)
    """
    bins: list[list[tuple[float, bool]]] = [[] for _ in range(BINS)]
    for confidence, right in judged:
        bins[min(int(BINS * confidence), BINS - 1)].append((confidence, right))
    return [
        ReliabilityBin(len(each), _mean([confidence for confidence, _ in each]), _mean([right for _, right in each]))
        for each in bins
    ]


def pooled(parts: Iterable[Sequence[Sequence[float]]]) -> list[ReliabilityBin]:
    """The bins of several sequences together; each bin may be any (frames, confidence, accuracy)."""
    totals = [[0.0, 0.0, 0.0] for _ in range(BINS)]
    for bins in parts:
        for total, (count, confidence, accuracy) in zip(totals, bins, strict=True):
            total[0] += count
            total[1] += count * confidence
            total[2] += count * accuracy
    return [
        ReliabilityBin(int(count), confidence / max(1.0, count), accuracy / max(1.0, count))
        for count, confidence, accuracy in totals
    ]


def expected_calibration_error(bins: Sequence[ReliabilityBin]) -> float | None:
    """The mean distance between confidence and accuracy of a bin, weighted by its frames; None without frames.

    >>> expected_calibration_error([ReliabilityBin(3, 0.9, 1.0), ReliabilityBin(1, 0.5, 0.0)])
    0.19999999999999998
    """
    frames = sum(each.frames for each in bins)
    if frames == 0:
        return None
    return sum(each.frames * abs(each.confidence - each.accuracy) for each in bins) / frames


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else 0.0
