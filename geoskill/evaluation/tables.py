"""Tables over several trainings: accuracy beside what was published, and every figure of every test."""

import csv
import io
from collections.abc import Mapping, Sequence
from statistics import mean, median, stdev
from typing import Any

from geoskill.evaluation.calibration import ReliabilityBin, expected_calibration_error, pooled

Scores = Mapping[str, Sequence[Mapping[str, Any]]]
"""The scores of every seed by row; each has ``rsw``, ``steps`` and the figures of every test by its name."""

DETAILS = {
    "top-1": "top1_accuracy",
    "strict": "strict_accuracy",
    "oracle": "oracle_strict_accuracy",
    "error at the goal [mm]": "goal_error_mm",
    "oracle [mm]": "oracle_goal_error_mm",
    "precision": "precision",
    "hand": "hand_rate",
    "switches per frame": "switches_per_frame",
    "autocorrelation of the error": "error_autocorrelation",
}


def overview(scores: Scores, tests: Sequence[str], published: Mapping[str, Mapping[str, float]]) -> str:
    """A Markdown table of top-1 accuracy in percent: mean, standard deviation, median and worst of the seeds.

    Args:
        scores: of every row.
        tests: columns.
        published: percent by row and test; beside a row's own figures where it has the same name, below them otherwise.

    >>> seeds = [{"rsw": 0.002, "steps": 400, "human": {"top1_accuracy": x}} for x in (0.9, 1.0, 0.95)]
    >>> print(overview({"default": seeds}, ["human"], {"default": {"human": 80.0}}))
    | | seeds | human | RSW | steps |
    |---|---|---|---|---|
    | default | 3 | 95.0 ± 5.0, median 95.0, worst 90.0 (published 80.0) | 0.20 % | 400 |
    <BLANKLINE>
    """
    lines = [_line(["", "seeds", *tests, "RSW", "steps"]), "|" + "---|" * (len(tests) + 4)]
    for row, seeds in scores.items():
        cells = [row, str(len(seeds))]
        for test in tests:
            known = published.get(row, {}).get(test)
            cells.append(_spread(seeds, test) + ("" if known is None else f" (published {known:.1f})"))
        rsw, steps = (median(seed[key] for seed in seeds) for key in ("rsw", "steps"))
        lines.append(_line([*cells, f"{100 * rsw:.2f} %", f"{steps:.0f}"]))
    for row, values in published.items():
        if row not in scores:
            shown = [f"{values[test]:.1f}" if test in values else "" for test in tests]
            lines.append(_line([row, "", *shown, "", ""]))
    return "\n".join(lines) + "\n"


def details(scores: Scores, tests: Sequence[str]) -> str:
    """A Markdown table of all figures, means over the seeds, one line per row and test.

    The calibration error is of the frames of all seeds and tests of a row together.
    """
    lines = [_line(["", "test", *DETAILS, "feasible frames", "calibration error"]), "|" + "---|" * (len(DETAILS) + 4)]
    for row, seeds in scores.items():
        for test in tests:
            figures = [seed[test] for seed in seeds if test in seed]
            if not figures:
                continue
            cells = []
            for key in DETAILS.values():
                values = [each[key] for each in figures if each.get(key) is not None]
                digits = 1 if key.endswith("_mm") else 3
                cells.append(f"{mean(values):.{digits}f}" if values else "")
            feasible, frames = (sum(each[key] for each in figures) for key in ("feasible_frames", "frames"))
            lines.append(_line([row, test, *cells, f"{feasible} of {frames}", ""]))
        error = expected_calibration_error(reliability_of(seeds, tests))
        lines.append(_line([row, "all", *[""] * (len(DETAILS) + 1), "" if error is None else f"{error:.3f}"]))
    return "\n".join(lines) + "\n"


def as_csv(scores: Scores, tests: Sequence[str]) -> str:
    """One line per row, seed and test, with every figure that is a number."""
    rows = []
    for row, seeds in scores.items():
        for seed in seeds:
            for test in tests:
                place = {"row": row, "seed": seed.get("seed"), "test": test, "training_rsw": seed["rsw"]}
                figures = seed.get(test, {}).items()
                rows.append(place | {key: value for key, value in figures if isinstance(value, bool | int | float)})
    text = io.StringIO()
    writer = csv.DictWriter(text, list(dict.fromkeys(key for row in rows for key in row)), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def reliability_of(seeds: Sequence[Mapping[str, Any]], tests: Sequence[str]) -> list[ReliabilityBin]:
    """The frames of all seeds and tests by confidence; of an ensemble those of its first member."""
    return pooled(seed[test]["reliability"] for seed in seeds for test in tests if test in seed)


def accuracies(seeds: Sequence[Mapping[str, Any]], test: str) -> list[float]:
    """Top-1 accuracy in percent of the seeds that have one."""
    figures = [seed[test]["top1_accuracy"] for seed in seeds if test in seed]
    return [100 * value for value in figures if value is not None]


def _spread(seeds: Sequence[Mapping[str, Any]], test: str) -> str:
    values = accuracies(seeds, test)
    if not values:
        return "none"
    if len(values) == 1:
        return f"{values[0]:.1f}"
    return f"{mean(values):.1f} ± {stdev(values):.1f}, median {median(values):.1f}, worst {min(values):.1f}"


def _line(cells: Sequence[str]) -> str:
    return ("| " + " | ".join(cells) + " |").replace("|  |", "| |").replace("|  |", "| |")
