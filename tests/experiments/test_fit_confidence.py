"""The fit of the confidence's constants, on frames that follow a known law."""

import csv
import importlib.util
import math
import subprocess
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

SCRIPT = Path(__file__).resolve().parents[2] / "docs" / "experiments" / "fit_confidence.py"
COLUMNS = ("frame", "kernel", "descriptor", "has_association", "feasible", "correct", "confidence")


def load_script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fit_confidence", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


script = load_script()


def present_confidence(margin: float) -> float:
    return 1 / (1 + math.exp(-9.9 * (margin - 0.55)))


def row(confidence: Any, correct: Any, **values: Any) -> dict[str, Any]:
    defaults = {"frame": 0, "kernel": "p2p", "descriptor": "sift", "has_association": True, "feasible": True}
    return {**defaults, "correct": correct, "confidence": confidence, **values}


def write(study: Path, seed: int | str, test_set: str, rows: Iterable[Mapping[str, Any]]) -> None:
    folder = study / str(seed) / test_set
    folder.mkdir(parents=True)
    with (folder / "frames.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, fieldnames=COLUMNS, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


def exact_rows() -> list[dict[str, Any]]:
    """One of four frames is right at x = 0, and three of four at x = 1: slope 2 ln 3, midpoint 1/2, area 3/4."""
    low, high = present_confidence(0.0), present_confidence(1.0)
    return [row(low, frame < 1) for frame in range(4)] + [row(high, frame < 3) for frame in range(4)]


def test_constants_are_those_of_the_code() -> None:
    from geoskill.model.confidence import PLATT_MIDPOINT, PLATT_SLOPE

    assert (PLATT_SLOPE, PLATT_MIDPOINT) == (script.PRESENT.slope, script.PRESENT.midpoint) == (9.9, 0.55)


@given(st.lists(st.floats(-0.5, 1.5), min_size=1))
def test_margins_invert_the_confidences_of_the_code(margins: list[float]) -> None:
    import torch

    from geoskill.model.confidence import confidences

    # Scores of mean 0 whose first one has the margin times the reference.
    for margin in margins:
        scores = torch.tensor([3 * margin, -3 * margin], dtype=torch.float64)
        confidence = confidences(scores, torch.tensor(3.0, dtype=torch.float64))[:1].numpy()
        np.testing.assert_allclose(script.PRESENT.margins(confidence), [margin], atol=1e-6)


def test_fit_of_two_margins_is_exact() -> None:
    margins = np.repeat([0.0, 1.0], 4)
    correct = np.array([True, False, False, False, True, True, True, False])
    fitted = script.fit(margins, correct, "frames")
    assert (fitted.slope, fitted.midpoint) == pytest.approx((2 * math.log(3), 0.5), abs=1e-5)
    np.testing.assert_allclose(fitted.confidences(np.array([0.0, 1.0])), [0.25, 0.75], atol=1e-5)


def test_table_of_two_seeds_is_exact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Of the seed that is left out, 1/4 and 3/4 are right, as the other predicts.
    write(tmp_path, 3, "occlusion", exact_rows())
    write(tmp_path, 4, "occlusion", exact_rows())
    assert script.main([str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines() == [
        "| left out | frames | right | slope | midpoint | calibration error | area |",
        "|---|---|---|---|---|---|---|",
        "| seed 3 | 8 | 4 | 2.20 | 0.500 | 0.000 | 0.750 |",
        "| seed 4 | 8 | 4 | 2.20 | 0.500 | 0.000 | 0.750 |",
        "| none | 16 | 8 | 2.20 | 0.500 | 0.000 | 0.750 |",
        "",
        "0 confidences that round to 0 or 1 were clipped.",
        "0 frames without an association were left out.",
    ]


def test_calibration_error_is_that_of_the_other_seeds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # Seed 4 has 1/8 and 7/8 where seed 3 has 1/4 and 3/4: each is 1/8 off the other's prediction.
    low, high = present_confidence(0.0), present_confidence(1.0)
    write(tmp_path, 3, "occlusion", exact_rows())
    write(tmp_path, 4, "occlusion", [row(low, n < 1) for n in range(8)] + [row(high, n < 7) for n in range(8)])
    assert script.main([str(tmp_path)]) == 0
    without_3, without_4, of_all = capsys.readouterr().out.splitlines()[2:5]
    assert without_3 == f"| seed 3 | 8 | 4 | {2 * math.log(7):.2f} | 0.500 | 0.125 | 0.750 |"
    assert without_4 == "| seed 4 | 16 | 8 | 2.20 | 0.500 | 0.125 | 0.875 |"
    # Together 2 of 12 and 10 of 12 are right: odds of 5.
    assert of_all == f"| none | 24 | 12 | {2 * math.log(5):.2f} | 0.500 | 0.125 | 0.833 |"


def test_one_seed_has_no_calibration_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, 3, "occlusion", exact_rows())
    assert script.main([str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[2] == "| none | 8 | 4 | 2.20 | 0.500 | none | 0.750 |"


@pytest.mark.parametrize(("slope", "midpoint"), [(9.9, 0.55), (4.0, 0.8), (15.0, 0.3)])
def test_a_known_law_is_recovered(tmp_path: Path, slope: float, midpoint: float) -> None:
    random = np.random.default_rng(0)
    for seed in (3, 4, 5, 6):
        for test_set in ("occlusion", "outside_fov"):
            margins = random.uniform(0, 1.4, 2000)
            correct = random.random(2000) < 1 / (1 + np.exp(-slope * (margins - midpoint)))
            outcomes = zip(margins.tolist(), correct.tolist(), strict=True)
            write(tmp_path, seed, test_set, [row(present_confidence(margin), right) for margin, right in outcomes])
    frames = script.read_frames([tmp_path])
    assert sorted(set(frames.seeds.tolist())) == [3, 4, 5, 6]
    fitted = script.fit(frames.margins, frames.correct, "frames")
    assert fitted.slope == pytest.approx(slope, rel=0.05)
    assert fitted.midpoint == pytest.approx(midpoint, abs=0.01)
    error = float(script.table(frames).splitlines()[-1].split("|")[6])
    assert error < 0.01


def test_infeasible_frames_are_wrong_and_empty_ones_left_out(tmp_path: Path) -> None:
    rows = [row(0.5, True, feasible=False), row(0.5, True), row(0.0, False, has_association=False), row(0.5, False)]
    write(tmp_path, 3, "occlusion", rows)
    frames = script.read_frames([tmp_path])
    assert frames.correct.tolist() == [False, True, False]
    assert frames.margins.tolist() == [0.55, 0.55, 0.55]
    assert (frames.num_empty, frames.num_clipped) == (1, 0)


def test_rounded_confidences_are_clipped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, 3, "occlusion", [*exact_rows(), row(1.0, True), row(1.0, True), row(0.0, False)])
    margins = script.read_frames([tmp_path]).margins
    # log(2^24 - 1) / 9.9 from the midpoint on either side
    assert margins[-3:].tolist() == pytest.approx([0.55 + 1.68036, 0.55 + 1.68036, 0.55 - 1.68036], abs=1e-5)
    assert script.main([str(tmp_path)]) == 0
    assert "\n3 confidences that round to 0 or 1 were clipped.\n" in capsys.readouterr().out


def test_a_folder_given_twice_counts_once(tmp_path: Path) -> None:
    write(tmp_path, 3, "occlusion", exact_rows())
    assert len(script.read_frames([tmp_path, tmp_path / "3" / "occlusion"]).margins) == 8


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([row(0.9, True), row(0.1, True)], "all seeds: every frame is right; expected frames that are right and"),
        ([row(0.9, False), row(0.1, False)], "all seeds: every frame is wrong; expected frames that are right and"),
        ([row(0.0, False, has_association=False)], "all seeds: every frame has no association; expected frames"),
        ([], "all seeds: every frame has no association; expected frames"),
        ([row(0.9, True), row(0.1, False)], "all seeds: one margin separates right from wrong frames, so that no"),
        ([row(0.5, True), row(0.5, False)], "all seeds: one margin separates right from wrong frames, so that no"),
        ([row(0.2, n != 0) for n in range(3)] + [row(0.9, n == 0) for n in range(3)], "all seeds: the slope is -"),
        ([row("high", True)], "{file}, line 2: confidence is 'high'; expected a number from 0 to 1"),
        ([row("nan", True)], "{file}, line 2: confidence is 'nan'; expected a number from 0 to 1"),
        ([row(0.5, True), row(1.5, True)], "{file}, line 3: confidence is '1.5'; expected a number from 0 to 1"),
        ([row(0.5, "yes")], "{file}, line 2: correct is 'yes'; expected True or False"),
    ],
)
def test_unusable_frames_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: list[dict[str, Any]], message: str
) -> None:
    write(tmp_path, 3, "occlusion", rows)
    assert script.main([str(tmp_path)]) == 2
    printed = capsys.readouterr()
    assert (printed.out, printed.err.count("\n")) == ("", 1)
    file = tmp_path / "3" / "occlusion" / "frames.csv"
    assert printed.err.startswith(f"error: {message.format(file=file)}")


def test_a_seed_that_the_others_cannot_do_without_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, 3, "occlusion", exact_rows())
    write(tmp_path, 4, "occlusion", [row(0.9, True)])
    assert script.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.startswith("error: without seed 3: every frame is right; expected")


@pytest.mark.parametrize("column", ["has_association", "feasible", "correct", "confidence"])
def test_a_missing_column_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], column: str) -> None:
    write(tmp_path, 3, "occlusion", exact_rows())
    path = tmp_path / "3" / "occlusion" / "frames.csv"
    header, _, body = path.read_text().partition("\n")
    path.write_text(f"{header.replace(column, 'other')}\n{body}")
    assert script.main([str(tmp_path)]) == 2
    expected = f"error: {path}: has no column {column!r}; expected has_association, feasible, correct, confidence\n"
    assert capsys.readouterr().err == expected


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00", b"\n"])
def test_a_file_that_is_no_table_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], content: bytes) -> None:
    write(tmp_path, 3, "occlusion", [])
    (tmp_path / "3" / "occlusion" / "frames.csv").write_bytes(content)
    assert script.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_folder_that_is_no_seed_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, "best", "occlusion", exact_rows())
    assert script.main([str(tmp_path)]) == 2
    assert capsys.readouterr().err.endswith("'best' is no seed; expected SEED/TEST_SET/frames.csv\n")


@pytest.mark.slow
def test_the_command_says_that_there_are_no_frames(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, SCRIPT, tmp_path], capture_output=True, text=True, check=False)
    expected = f"error: {tmp_path}: contains no frames.csv; expected SEED/TEST_SET/frames.csv, as a study has them\n"
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", expected)
