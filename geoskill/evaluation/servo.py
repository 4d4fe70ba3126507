"""Metrics of a benchmark of servoing: success with its interval, errors, and what the loop says of itself."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from geoskill.control.trial import TrialResult

SUCCESS_MM: Final = 5.0
SUCCESS_DEG: Final = 3.0
COARSE_RATIO: Final = 0.1
COARSE_DEG: Final = 10.0
"""The criterion of CNS (Chen et al., 2023): a tenth of the distance, and ten degrees."""
CONFIDENCE_Z: Final = 1.959964


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the interval that holds the true rate in 95 of 100 cases (Wilson, 1927).

    >>> [round(bound, 3) for bound in wilson_interval(95, 100)]
    [0.888, 0.978]

    Raises:
        ValueError: when there are no trials, or fewer than successes.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(
            f"{successes} successes of {trials} trials; expected at least one trial, and no more successes"
        )
    rate, square = successes / trials, CONFIDENCE_Z**2
    center = (rate + square / (2 * trials)) / (1 + square / trials)
    half = CONFIDENCE_Z * math.sqrt(rate * (1 - rate) / trials + square / (4 * trials**2)) / (1 + square / trials)
    return max(0.0, center - half), min(1.0, center + half)


def is_success(result: TrialResult) -> bool:
    """Return whether the thing ended within 5 mm and 3 degrees of its goal, and the loop said that it was done."""
    return result.ended == "done" and result.mm <= SUCCESS_MM and result.deg <= SUCCESS_DEG


def summarize_trials(results: Sequence[TrialResult]) -> dict[str, Any]:
    """Return the metrics of trials, at least one."""
    successes = sum(map(is_success, results))
    coarse = sum(
        own.ended == "done" and own.mm <= COARSE_RATIO * own.start_mm and own.deg <= COARSE_DEG for own in results
    )
    columns: Mapping[str, np.ndarray] = {
        key: np.array([getattr(own, key) for own in results], np.float64)
        for key in ("mm", "along_mm", "across_mm", "deg", "steps", "path_ratio", "held", "wrong_top", "seconds")
    }
    told = [own.mm / own.predicted_mm for own in results if own.predicted_mm]
    return {
        "trials": len(results),
        "success_rate": successes / len(results),
        "success_interval": [round(bound, 4) for bound in wilson_interval(successes, len(results))],
        "success_rate_coarse": coarse / len(results),
        "done_rate": sum(own.ended == "done" for own in results) / len(results),
        **{f"median_{key}": round(float(np.median(own)), 4) for key, own in columns.items()},
        "p95_mm": round(float(np.quantile(columns["mm"], 0.95)), 4),
        "p95_deg": round(float(np.quantile(columns["deg"], 0.95)), 4),
        "reexplored": sum(own.explorations > 1 for own in results),
        "measured_over_predicted": round(float(np.median(told)), 4) if told else None,
        "predicted_within_factor_2": round(float(np.mean([0.5 <= own <= 2 for own in told])), 4) if told else None,
        "violations": sum(own.violations for own in results),
    }
