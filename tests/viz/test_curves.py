"""Tests of the curves: drawn lines hold the given numbers, PNG files are whole or not there."""

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoskill.errors import InputError
from geoskill.viz.curves import inference_figure, plot_inference, plot_training, read_training, training_figure

TABLE = """epoch,step,p2p_sift/objective,p2p_sift/reward,p2p_sift/rsw,p2p_sift/error,l2l_lbd/objective,l2l_lbd/rsw,lr
0,0,-0.5,0.1,0.9,100.0,-0.25,0.5,0.001
0,10,,,,,-0.125,,
1,20,0.25,nan,0.01,50.0,,0.25,
"""


@pytest.fixture
def table(tmp_path: Path) -> Path:
    path = tmp_path / "metrics.csv"
    path.write_text(TABLE)
    return path


def drawn(axes: Axes) -> dict[str, tuple[list[float], list[float]]]:
    return {
        str(line.get_label()): (list(np.asarray(line.get_xdata())), list(np.asarray(line.get_ydata())))
        for line in axes.get_lines()
    }


def legend(figure: Figure) -> list[str]:
    return [text.get_text() for drawn_legend in figure.legends for text in drawn_legend.get_texts()]


def size_of_png(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    assert data[-12:] == b"\x00\x00\x00\x00IEND\xaeB`\x82"
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_training_figure_draws_the_table(table: Path) -> None:
    figure = training_figure(read_training(table))
    objective, reward, rsw, error = figure.axes
    assert drawn(objective) == {"p2p_sift": ([0, 20], [-0.5, 0.25]), "l2l_lbd": ([0, 10], [-0.25, -0.125])}
    assert drawn(reward) == {"p2p_sift": ([0], [0.1])}
    assert drawn(rsw) == {"p2p_sift": ([0, 20], [90.0, 1.0]), "l2l_lbd": ([0, 20], [50.0, 25.0])}
    assert drawn(error) == {"p2p_sift": ([0, 20], [100.0, 50.0])}
    assert [axes.get_ylabel() for axes in figure.axes] == ["objective", "reward", "RSW [%]", "$E_c$ [px, m]"]
    assert [axes.get_yscale() for axes in figure.axes] == ["linear", "linear", "log", "linear"]
    assert legend(figure) == ["p2p_sift", "l2l_lbd"]


def test_training_figure_colors_by_member(table: Path) -> None:
    figure = training_figure(read_training(table))
    colors = {
        label: {line.get_color() for axes in figure.axes for line in axes.get_lines() if line.get_label() == label}
        for label in ("p2p_sift", "l2l_lbd")
    }
    assert all(len(of_member) == 1 for of_member in colors.values())
    assert colors["p2p_sift"] != colors["l2l_lbd"]


def test_training_figure_of_many_members() -> None:
    curves = {f"member{i}": (np.array([0.0, 1.0]), np.array([0.0, float(i)])) for i in range(12)}
    objective = training_figure({"objective": curves}).axes[0]
    assert len({(line.get_color(), line.get_linestyle()) for line in objective.get_lines()}) == 12


def test_training_figure_with_rsw_of_zero(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("step,p2p_sift/rsw\n0,0\n1,0\n")
    assert training_figure(read_training(path)).axes[2].get_yscale() == "linear"
    path.write_text("step,p2p_sift/rsw\n0,0.5\n1,0\n")
    figure = training_figure(read_training(path))
    assert figure.axes[2].get_yscale() == "log"
    plot_training(path, tmp_path / "training.png")
    assert figure.axes[2].get_ylim()[0] > 0


def test_plot_training_writes_png(table: Path, tmp_path: Path) -> None:
    picture = tmp_path / "training.png"
    plot_training(table, picture)
    assert size_of_png(picture) == (1350, 900)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["metrics.csv", "training.png"]


def test_plot_training_keeps_earlier_file_on_failure(
    table: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    picture = tmp_path / "training.png"
    picture.write_bytes(b"of an earlier run")

    def fail(self: Figure, path: Path, **_options: str) -> None:
        Path(path).write_bytes(b"half a pict")
        raise OSError("no space left")

    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(OSError, match="no space left"):
        plot_training(table, picture)
    assert picture.read_bytes() == b"of an earlier run"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["metrics.csv", "training.png"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"metrics\.csv: its columns are none; expected step and"),
        ("step,loss\n0,1\n", r"metrics\.csv: its columns are step, loss; expected step and, .*<member>/objective"),
        ("p2p_sift/reward\n1\n", r"metrics\.csv: its columns are p2p_sift/reward; expected step"),
        ("step,p2p_sift/reward\n", r"metrics\.csv: the table holds no number"),
        ("step,p2p_sift/reward\n0,\n", r"metrics\.csv: the table holds no number"),
        ("step,p2p_sift/reward\n0,1\n1,high\n", r"metrics\.csv line 3, p2p_sift/reward: 'high' is not a number"),
        ("step,p2p_sift/reward\n0,1\n1", None),
    ],
)
def test_read_training_refuses_bad_tables(tmp_path: Path, text: str, message: str | None) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text(text)
    if message is None:  # a last row cut short is what a run in progress leaves
        assert read_training(path)["reward"]["p2p_sift"][1].tolist() == [1.0]
        return
    with pytest.raises(InputError, match=message):
        read_training(path)


def test_plot_training_refuses_missing_table(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.csv: cannot be read"):
        plot_training(tmp_path / "absent.csv", tmp_path / "training.png")
    assert list(tmp_path.iterdir()) == []


ROWS = [
    (0, "p2p_sift", 0.5, 80.0),
    (0, "l2l_lbd", 0.4, 12.0),
    (1, "p2p_sift", 0.75, 40.0),
    (2, "l2l_lbd", 0.9, 6.0),
    (2, "p2p_sift", math.nan, math.nan),
]


def test_inference_figure_draws_rows_with_gaps() -> None:
    figure = inference_figure(ROWS)
    error, confidence = figure.axes
    nan = math.nan
    expected_error = {"p2p_sift": [80.0, 40.0, nan], "l2l_lbd": [12.0, nan, 6.0]}
    expected_confidence = {"p2p_sift": [0.5, 0.75, nan], "l2l_lbd": [0.4, nan, 0.9]}
    for axes, expected in ((error, expected_error), (confidence, expected_confidence)):
        lines = drawn(axes)
        assert list(lines) == list(expected)
        for member, values in expected.items():
            assert lines[member][0] == [0, 1, 2]
            np.testing.assert_array_equal(lines[member][1], values)
    assert legend(figure) == ["p2p_sift", "l2l_lbd"]
    assert confidence.get_ylim() == (0.0, 1.03)


@pytest.mark.parametrize("rows", [ROWS, []], ids=["rows", "no instance in any frame"])
def test_plot_inference_writes_png(rows: list[tuple[int, str, float, float]], tmp_path: Path) -> None:
    plot_inference(rows, tmp_path / "inference.png")
    assert size_of_png(tmp_path / "inference.png") == (1350, 750)
    assert [file.name for file in tmp_path.iterdir()] == ["inference.png"]
