"""Fit the two constants of the confidence, PLATT_SLOPE and PLATT_MIDPOINT of ``geoskill/model/confidence.py``.

The input is the study ``conf/artifact/confidence.yaml``: simulated sorting, seeds 3 to 6, the five scenarios of
table I, every third frame::

    python reproduce.py artifact=confidence
    python docs/experiments/fit_confidence.py outputs/reproduce/confidence/full

For every SEED and SCENARIO, the study runs two commands; the script reads the ``frames.csv`` of the second::

    python train.py task=sorting seed=SEED threads=1 logger=none hydra.run.dir=RUN/SEED
    python evaluate.py skill=RUN/SEED task=sorting scenario=SCENARIO every=3 inference.temporal=none
                       inference.abstain=0 hydra.run.dir=RUN/SEED/SCENARIO

``inference.temporal=none`` selects in each frame by itself; ``inference.abstain=0`` keeps the associations of low
confidence, without which the fit would be biased.

The confidences of the runs were computed with the present constants; the factor for pictures of nothing is not taken
out, and is near 1 where the first is not small. Inverting these gives the margin x relative to the
demonstration's, and a logistic regression without regularization (Platt 1999) of whether the best association is right
gives the new constants. A frame in which the right association cannot be seen counts as wrong. After the constants have
been changed, the study has to be evaluated again before the next fit.

The script prints a Markdown table. The calibration error of a seed is that of the constants fitted to the other seeds.
The last row has the constants fitted to all seeds, and the calibration error over all frames, each predicted without
its own seed. The area under the ROC curve is that of the margin.
"""

import argparse
import csv
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import expit, logit
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score

from geoskill.errors import InputError
from geoskill.evaluation.calibration import expected_calibration_error, reliability
from geoskill.model.confidence import PLATT_MIDPOINT, PLATT_SLOPE

FRAMES = "frames.csv"
COLUMNS = ("has_association", "feasible", "correct", "confidence")
TRUTH = {"True": True, "False": False}
# Confidences are float32: the largest below 1 is 1 minus this.
ROUNDING = float(np.finfo(np.float32).epsneg)


@final
@dataclass(frozen=True)
class Frames:
    """Evaluated frames that have an association.

    Attributes:
        margins: x, the score margin of the best association relative to the reference margin.
        correct: whether the best association is right.
        seeds: seed of the skill's training.
        num_clipped: number of confidences that had been rounded to 0 or 1; their margins are bounds.
        num_empty: number of frames that were left out, since they have no association.
    """

    margins: Float[np.ndarray, " frames"]
    correct: Bool[np.ndarray, " frames"]
    seeds: Int[np.ndarray, " frames"]
    num_clipped: int = 0
    num_empty: int = 0


@final
@dataclass(frozen=True)
class PlattScaling:
    """A logistic law: confidence = 1 / (1 + exp(-slope (x - midpoint)))."""

    slope: float
    midpoint: float

    def confidences(self, margins: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
        """Return the probability that an association of each margin is right."""
        return np.asarray(expit(self.slope * (margins - self.midpoint)))

    def margins(self, confidences: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
        """Return the margin at which each confidence, between 0 and 1, is reached."""
        return np.asarray(self.midpoint + logit(confidences) / self.slope)


PRESENT = PlattScaling(PLATT_SLOPE, PLATT_MIDPOINT)


def read_frames(studies: Sequence[Path]) -> Frames:
    """Read all ``SEED/TEST_SET/frames.csv`` below these folders.

    Raises:
        InputError: when there is none, the folder above is not named by a seed, or a file cannot be used.
    """
    paths = sorted({path.resolve() for study in studies for path in study.rglob(FRAMES)})
    if not paths:
        folders = ", ".join(str(study) for study in studies)
        raise InputError(f"{folders}: contains no {FRAMES}; expected SEED/TEST_SET/{FRAMES}, as a study has them")
    confidences: list[float] = []
    correct: list[bool] = []
    seeds: list[int] = []
    num_rows = 0
    for path in paths:
        seed = path.parent.parent.name
        if not seed.isdecimal():
            raise InputError(f"{path}: {seed!r} is no seed; expected SEED/TEST_SET/{FRAMES}")
        rows = _read_rows(path)
        outcomes = [outcome for outcome in rows if outcome is not None]
        num_rows += len(rows)
        confidences += [confidence for confidence, _ in outcomes]
        correct += [right for _, right in outcomes]
        seeds += [int(seed)] * len(outcomes)
    exact = np.array(confidences, dtype=float)
    clipped = np.clip(exact, ROUNDING, 1 - ROUNDING)
    return Frames(
        PRESENT.margins(clipped),
        np.array(correct, dtype=bool),
        np.array(seeds, dtype=int),
        num_clipped=int((clipped != exact).sum()),
        num_empty=num_rows - len(exact),
    )


def _read_rows(path: Path) -> list[tuple[float, bool] | None]:
    """Return confidence and correctness of every row; None for a frame without an association."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [name for name in COLUMNS if name not in (reader.fieldnames or ())]
            if missing:
                raise InputError(f"{path}: has no column {missing[0]!r}; expected {', '.join(COLUMNS)}")
            return [_outcome(row, f"{path}, line {reader.line_num}") for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected the {FRAMES} of evaluate.py") from error


def _outcome(row: Mapping[str, str], where: str) -> tuple[float, bool] | None:
    for name in COLUMNS[:3]:
        if row[name] not in TRUTH:
            raise InputError(f"{where}: {name} is {row[name]!r}; expected True or False")
    if not TRUTH[row["has_association"]]:
        return None
    try:
        confidence = float(row["confidence"])
    except (TypeError, ValueError):
        confidence = np.nan
    if not 0 <= confidence <= 1:
        raise InputError(f"{where}: confidence is {row['confidence']!r}; expected a number from 0 to 1")
    return confidence, TRUTH[row["correct"]] and TRUTH[row["feasible"]]


def fit(margins: Float[np.ndarray, " frames"], correct: Bool[np.ndarray, " frames"], name: str) -> PlattScaling:
    """Fit slope and midpoint by maximum likelihood.

    Args:
        margins: x of each frame.
        correct: whether the best association of each frame is right.
        name: what a message calls these frames.

    Raises:
        InputError: when all frames are right or all are wrong, or no positive slope is the most likely.
    """
    if correct.all() or not correct.any():
        classes = "has no association" if not len(correct) else "is right" if correct.all() else "is wrong"
        raise InputError(f"{name}: every frame {classes}; expected frames that are right and frames that are wrong")
    right, wrong = margins[correct], margins[~correct]
    if wrong.max() <= right.min() or right.max() <= wrong.min():
        raise InputError(
            f"{name}: one margin separates right from wrong frames, so that no finite slope is the most likely;"
            " expected more frames"
        )
    regression = LogisticRegression(C=np.inf, tol=1e-8, max_iter=10_000).fit(margins[:, None], correct)
    slope, intercept = float(regression.coef_.item()), float(regression.intercept_.item())
    if slope <= 0:
        raise InputError(f"{name}: the slope is {slope:.3g}; expected larger margins where frames are right")
    return PlattScaling(slope, -intercept / slope)


def table(frames: Frames) -> str:
    """Return the Markdown table: a row for each seed that is left out, and one for the constants of all seeds.

    Raises:
        InputError: when the frames do not determine the constants; see :func:`fit`.
    """
    fitted = fit(frames.margins, frames.correct, "all seeds")
    lines = ["| left out | frames | right | slope | midpoint | calibration error | area |", "|---" * 7 + "|"]
    held_out = np.full(len(frames.margins), np.nan)
    seeds = np.unique(frames.seeds)
    for seed in seeds if len(seeds) > 1 else ():
        test = frames.seeds == seed
        others = fit(frames.margins[~test], frames.correct[~test], f"without seed {seed}")
        held_out[test] = others.confidences(frames.margins[test])
        lines.append(_line(f"seed {seed}", others, frames.margins[test], held_out[test], frames.correct[test]))
    lines.append(_line("none", fitted, frames.margins, held_out, frames.correct))
    return "\n".join(lines)


def _line(
    name: str,
    constants: PlattScaling,
    margins: Float[np.ndarray, " frames"],
    held_out: Float[np.ndarray, " frames"],
    correct: Bool[np.ndarray, " frames"],
) -> str:
    """Return a row of the table; a value that these frames do not determine is ``none``."""
    error = area = "none"
    if not np.isnan(held_out).any():
        bins = reliability(zip(held_out.tolist(), correct.tolist(), strict=True))
        error = f"{expected_calibration_error(bins):.3f}"
    if correct.any() and not correct.all():
        area = f"{roc_auc_score(correct, margins):.3f}"
    counts = f"{len(correct)} | {int(correct.sum())}"
    return f"| {name} | {counts} | {constants.slope:.2f} | {constants.midpoint:.3f} | {error} | {area} |"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table of the runs that the command line names, and return the exit status."""
    parser = argparse.ArgumentParser(description="Fit the constants of the confidence to evaluated frames.")
    parser.add_argument("study", nargs="+", type=Path, help=f"folder that contains SEED/TEST_SET/{FRAMES}")
    try:
        frames = read_frames(parser.parse_args(arguments).study)
        markdown = table(frames)
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(markdown)
    print(f"\n{frames.num_clipped} confidences that round to 0 or 1 were clipped.")
    print(f"{frames.num_empty} frames without an association were left out.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
