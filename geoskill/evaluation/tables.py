"""Tables over several trainings: statistics over the seeds, published values, and the metrics of all test sets."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import pandas as pd

from geoskill.evaluation.calibration import ReliabilityBin, expected_calibration_error, pooled

Scores: TypeAlias = Mapping[str, Sequence[Mapping[str, Any]]]
"""The trainings by variant, one entry per seed: ``seed``, metrics of the training, and by its name each test set's."""

TRAINING_METRICS = ("top1_accuracy", "objective", "rsw", "mean_confidence", "steps")
"""Metrics of a training's ``metrics.json`` that are compared, where a training has them."""

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


def summarize(runs: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Average the metrics of trainings over their seeds.

    Args:
        runs: one row per training, with the columns ``by`` and any of :data:`TRAINING_METRICS`.
        by: columns that tell the settings apart; without any, all trainings are averaged.

    Returns:
        One row per setting, in the order of appearance: the columns ``by``, ``runs``, and for each metric ``NAME``, its
        mean, and ``NAME_sd``, its sample standard deviation (NaN of a single training).

    >>> runs = pd.DataFrame({"sigma0": ["0.3", "0.3", "1.0"], "objective": [1.0, 3.0, 5.0]})
    >>> summarize(runs, ["sigma0"]).values.tolist()[0]
    ['0.3', 2, 2.0, 1.4142135623730951]
    """
    numbers = runs[[name for name in TRAINING_METRICS if name in runs and runs[name].notna().any()]].astype(float)
    settings = [runs[key] for key in by] or [pd.Series("all", index=runs.index)]
    groups = numbers.groupby(settings, sort=False, dropna=False)
    summary = groups.agg(["mean", "std"])
    summary.columns = pd.Index([name if statistic == "mean" else f"{name}_sd" for name, statistic in summary.columns])
    summary.insert(0, "runs", groups.size())
    return summary.reset_index(drop=not by)


def summary_table(summary: pd.DataFrame) -> str:
    """Return what :func:`summarize` returned as Markdown, a metric's mean and standard deviation in one cell."""
    cells = {
        column: [
            _with_deviation(mean, deviation) for mean, deviation in zip(values, summary[f"{column}_sd"], strict=True)
        ]
        if f"{column}_sd" in summary
        else ["" if pd.isna(value) else str(value) for value in values]
        for column, values in summary.items()
        if not str(column).endswith("_sd")
    }
    return _markdown(pd.DataFrame(cells))


def training_frame(scores: Scores) -> pd.DataFrame:
    """Return one row per training: ``variant``, ``seed`` and :data:`TRAINING_METRICS`."""
    return pd.DataFrame(
        [
            {"variant": variant, "seed": training["seed"], **{name: training.get(name) for name in TRAINING_METRICS}}
            for variant, trainings in scores.items()
            for training in trainings
        ]
    )


def score_frame(scores: Scores, test_sets: Sequence[str]) -> pd.DataFrame:
    """Return one row per training and test set: ``variant``, ``seed``, ``test_set``, ``training_rsw`` and its metrics.

    Metrics are those that are numbers, and ``reliability``, the bins of :mod:`geoskill.evaluation.calibration`.
    """
    rows = []
    for variant, trainings in scores.items():
        for training in trainings:
            for test_set in test_sets:
                metrics = {
                    name: value
                    for name, value in training[test_set].items()
                    if name == "reliability" or value is None or isinstance(value, bool | int | float)
                }
                origin = {"variant": variant, "seed": training["seed"], "test_set": test_set}
                rows.append({**origin, "training_rsw": training["rsw"], **metrics})
    return pd.DataFrame(rows)


def overview(scores: Scores, test_sets: Sequence[str], published: Mapping[str, Mapping[str, float]]) -> str:
    """Return top-1 accuracy in percent as Markdown: mean, standard deviation, median and worst of the seeds.

    Args:
        scores: of all variants.
        test_sets: the columns.
        published: percent by row and test set; beside a variant's own accuracy where it has the same name, in a row
            below otherwise.

    >>> seeds = [{"seed": 0, "rsw": 0.002, "steps": 400, "human": {"top1_accuracy": x}} for x in (0.9, 1.0, 0.95)]
    >>> print(overview({"default": seeds}, ["human"], {"default": {"human": 80.0}}).splitlines()[2])
    | default | 3       | 95.0 ± 5.0, median 95.0, worst 90.0 (published 80.0) | 0.20 % | 400     |
    """
    percentages = accuracies(score_frame(scores, test_sets), test_sets)
    training = training_frame(scores).groupby("variant")[["rsw", "steps"]].agg(["size", "median"])
    rows = []
    for variant, by_test_set in percentages.items():
        row = {"": variant, "seeds": str(training.loc[variant, ("rsw", "size")])}
        for test_set, values in zip(test_sets, by_test_set, strict=True):
            known = published.get(variant, {}).get(test_set)
            row[test_set] = _accuracy(values) + ("" if known is None else f" (published {known:.1f})")
        row["RSW"] = f"{100 * training.loc[variant, ('rsw', 'median')]:.2f} %"
        row["steps"] = f"{training.loc[variant, ('steps', 'median')]:.0f}"
        rows.append(row)
    for name, values_by_test_set in published.items():
        if name not in scores:
            rows.append({"": name, **{test_set: f"{value:.1f}" for test_set, value in values_by_test_set.items()}})
    return _markdown(pd.DataFrame(rows, columns=["", "seeds", *test_sets, "RSW", "steps"]).fillna(""))


def details(scores: Scores, test_sets: Sequence[str]) -> str:
    """Return all metrics as Markdown, means over the seeds, one line per variant and test set.

    The calibration error is of the frames of all seeds and test sets of a variant together.
    """
    rows: list[dict[str, str]] = []
    for variant, frames in score_frame(scores, test_sets).groupby("variant", sort=False):
        for test_set, metrics in frames.groupby("test_set", sort=False):
            means = metrics.reindex(columns=list(DETAILS.values())).astype(float).mean()
            cells = {title: _number(means[name], 1 if name.endswith("_mm") else 3) for title, name in DETAILS.items()}
            counts = metrics[["feasible_frames", "frames"]].sum()
            feasible = f"{counts['feasible_frames']} of {counts['frames']}"
            rows.append({"": str(variant), "test set": str(test_set), **cells, "feasible frames": feasible})
        error = expected_calibration_error(reliability_of(frames))
        rows.append({"": str(variant), "test set": "all", "calibration error": _number(error, 3)})
    columns = ["", "test set", *DETAILS, "feasible frames", "calibration error"]
    return _markdown(pd.DataFrame(rows, columns=columns).fillna(""))


def csv_table(frame: pd.DataFrame) -> str:
    """Return all numbers of a frame as CSV, without the columns that are empty throughout."""
    return str(frame.drop(columns="reliability", errors="ignore").dropna(axis="columns", how="all").to_csv(index=False))


def accuracies(frame: pd.DataFrame, test_sets: Sequence[str]) -> dict[str, list[list[float]]]:
    """Return top-1 accuracy in percent by variant, for each test set that of the seeds that have one.

    Args:
        frame: see :func:`score_frame`.
        test_sets: their order.
    """
    percentages = (100 * frame["top1_accuracy"].astype(float)).dropna()
    return {
        str(variant): [
            percentages[variant_frame.index[variant_frame["test_set"] == name].intersection(percentages.index)].tolist()
            for name in test_sets
        ]
        for variant, variant_frame in frame.groupby("variant", sort=False)
    }


def baseline_success(frame: pd.DataFrame) -> dict[str, float]:
    """Return the percentage of recordings on which hand-picked trackers succeed, by test set.

    All variants are scored on the same recordings, so those of the first one count.
    """
    recordings = frame[frame["variant"] == frame["variant"].iloc[0]]
    success = 100 * recordings["baseline_success"].astype(float).groupby(recordings["test_set"], sort=False).mean()
    return {str(test_set): float(percent) for test_set, percent in success.items()}


def reliability_of(frame: pd.DataFrame) -> list[ReliabilityBin]:
    """Return the frames of all rows by confidence; of an ensemble those of its first member."""
    return pooled(frame["reliability"])


def _accuracy(values: Sequence[float]) -> str:
    seeds = pd.Series(values, dtype=float)
    if len(seeds) < 2:
        return f"{seeds[0]:.1f}" if len(seeds) else "none"
    return f"{seeds.mean():.1f} ± {seeds.std():.1f}, median {seeds.median():.1f}, worst {seeds.min():.1f}"


def _with_deviation(mean: float, deviation: float) -> str:
    if pd.isna(mean):
        return ""
    return f"{mean:.4g}" if pd.isna(deviation) else f"{mean:.4g} ± {deviation:.2g}"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None or pd.isna(value) else f"{value:.{digits}f}"


def _markdown(table: pd.DataFrame) -> str:
    return f"{table.to_markdown(index=False, disable_numparse=True)}\n"
