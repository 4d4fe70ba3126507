"""``python evaluate.py`` on frames that the test labels itself."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import pytest

Command = Callable[..., Any]

FRAMES = 20


def write_regions(path: Path, moving_is_object: bool) -> Path:
    """The left tile, which moves by 2.5 px a frame, is the object and the right one the target, or the other way."""

    def square(x: float, y: float) -> list[list[float]]:
        return [[x, y], [x + 32, y], [x + 32, y + 32], [x, y + 32]]

    names = ("object", "target") if moving_is_object else ("target", "object")
    frames = {
        str(number): {names[0]: square(28 + 2.5 * number, 46), names[1]: square(108, 46), "hand": square(60, 88)}
        for number in (0, FRAMES - 1)
    }
    path.write_text(json.dumps({"image_size": [160, 120], "frames": frames}))
    return path


@pytest.mark.slow
def test_labels_of_labelme_give_the_same_metrics(
    command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    own = json.loads(write_regions(tmp_path / "regions.json", True).read_text())
    (tmp_path / "labels").mkdir()
    names = {"object": "mug", "target": "coaster", "hand": "glove"}
    for number, regions in own["frames"].items():
        shapes = [{"label": names[name], "points": points, "shape_type": "polygon"} for name, points in regions.items()]
        picture = {"imagePath": f"../{int(number):03d}.png", "imageWidth": 160, "imageHeight": 120}
        (tmp_path / "labels" / f"{number}.json").write_text(json.dumps({**picture, "shapes": shapes}))
    arguments = [f"skill={skill}", f"video={demonstration_folder}", "every=4"]
    called = [f"regions.{name}={label}" for name, label in names.items()]
    runs = [
        command("evaluate", *arguments, *given, f"hydra.run.dir={tmp_path / name}")
        for name, given in (
            ("own", [f"regions={tmp_path / 'regions.json'}"]),
            ("labelme", [f"regions={tmp_path / 'labels'}", *called]),
        )
    ]
    assert [(run.status, run.stderr) for run in runs] == [(0, "")] * 2
    first, second = (json.loads((run.folder / "metrics.json").read_text()) for run in runs)
    assert first == second
    refused = command("evaluate", *arguments, f"regions={tmp_path / 'labels'}", "regions.object=cup")
    assert refused.status == 2
    assert refused.stderr.endswith("expected regions.object=LABEL, one of 'coaster', 'glove', 'mug'\n")


def test_metrics_and_frame_results(
    command: Command, skill: Path, trained: Any, demonstration_folder: Path, tmp_path: Path
) -> None:
    regions = write_regions(tmp_path / "regions.json", True)
    arguments = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}"]
    run = tmp_path / "run"
    ended = command("evaluate", *arguments, f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr, ended.folder) == (0, "", run)
    figures = json.loads((run / "metrics.json").read_text())
    expected = {"frames", "feasible_frames", "top1_accuracy", "hand_rate", "mean_confidence", "rsw"}
    assert expected | {"switches_per_frame"} <= figures.keys()
    assert figures["frames"] == FRAMES
    with (run / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == list(range(FRAMES))

    # Independently of the program: where do both ends of the top associations lie?
    def tile(x: float, y: float, number: int) -> str:
        for name, left, top in (("object", 28 + 2.5 * number, 46), ("target", 108, 46), ("hand", 60, 88)):
            if left <= x <= left + 32 and top <= y <= top + 32:
                return name
        return "none"

    lines = [json.loads(line) for line in (trained.folder / "associations.jsonl").read_text().splitlines()]
    for line in lines:
        if line["rank"] != 1:
            continue
        ends = [tile(*node["xy"], line["frame"]) for node in line["nodes"]]
        row = rows[line["frame"]]
        if "none" not in ends:  # whether something just beside a tile counts is not this test's business
            assert (row["hits_hand"] == "True") == ("hand" in ends)
            assert (row["correct"] == "True") == (set(ends) == {"object", "target"})
        assert float(row["confidence"]) == pytest.approx(line["confidence"], abs=1e-5)
    correct = sum(row["correct"] == "True" for row in rows)
    feasible = sum(row["feasible"] == "True" for row in rows)
    assert (figures["feasible_frames"], figures["frames"]) == (feasible, FRAMES)
    assert figures["top1_accuracy"] == pytest.approx(correct / feasible)


@pytest.mark.slow
@pytest.mark.parametrize("threads", [1, 3])
def test_threads_and_pictures_of_failures(
    command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path, threads: int
) -> None:
    """Whatever it selects, it is wrong with one of two targets."""
    tables = []
    for name, (left, top) in {"right": (108, 46), "below": (60, 88)}.items():
        target = [[left, top], [left + 32, top], [left + 32, top + 32], [left, top + 32]]
        tiles = [[28, 46], [107, 46], [107, 80], [28, 80]]
        frames = {key: {"object": tiles, "target": target, "hand": []} for key in ("0", str(FRAMES - 1))}
        regions = tmp_path / f"{name}.json"
        regions.write_text(json.dumps({"image_size": [160, 120], "frames": frames}))
        given = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}", f"threads={threads}"]
        ended = command("evaluate", *given, "failures=3", f"hydra.run.dir={tmp_path / name}")
        assert (ended.status, ended.stderr) == (0, "")
        with (tmp_path / name / "frames.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        wrong = [int(row["frame"]) for row in rows if row["feasible"] == "True" and row["correct"] == "False"]
        pictures = sorted((tmp_path / name / "failures").glob("*.jpg"))
        assert {int(path.stem) for path in pictures} <= set(wrong)
        assert min(len(wrong), 2) <= len(pictures) <= 3
        assert all(cv2.imread(str(path)).shape[0] >= 480 for path in pictures)
        assert ("  failures" in ended.stdout) == bool(wrong)
        tables.append((len(wrong), rows))
    assert max(wrong for wrong, _ in tables) > 3
    none = command("evaluate", *given, "failures=0", f"hydra.run.dir={tmp_path / 'none'}")
    assert not (none.folder / "failures").exists()
    with (none.folder / "frames.csv").open(newline="") as file:
        assert list(csv.DictReader(file)) == tables[-1][1]


@pytest.mark.slow
def test_abstaining_always_selects_nothing(
    command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    regions = write_regions(tmp_path / "regions.json", True)
    arguments = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}", "inference.abstain=1"]
    ended = command("evaluate", *arguments, f"hydra.run.dir={tmp_path / 'run'}")
    assert (ended.status, ended.stderr) == (0, "")
    figures = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert (figures["frames_without_association"], figures["top1_accuracy"], figures["precision"]) == (FRAMES, 0, None)


@pytest.mark.slow
def test_every_seventh_frame(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    regions = write_regions(tmp_path / "regions.json", False)
    arguments = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}", "every=7"]
    ended = command("evaluate", *arguments, f"hydra.run.dir={tmp_path}")
    assert ended.status == 0, ended.stderr
    with (tmp_path / "frames.csv").open(newline="") as file:
        assert [int(row["frame"]) for row in csv.DictReader(file)] == [0, 7, 14]


@pytest.mark.slow
def test_frames_without_labels_are_counted(
    command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    regions = write_regions(tmp_path / "regions.json", True)
    labeled = json.loads(regions.read_text())
    labeled["frames"]["7"] = labeled["frames"].pop(str(FRAMES - 1))
    regions.write_text(json.dumps(labeled))
    arguments = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}", "every=3"]
    ended = command("evaluate", *arguments, f"hydra.run.dir={tmp_path / 'run'}")
    assert (ended.status, ended.stderr) == (0, "")
    # 0, 3 and 6 have labels; 9, 12, 15 and 18 have none.
    assert "4 frames to be evaluated have no labels and were left out\n" in ended.stdout
    assert not (tmp_path / "run" / "evaluate.log").exists()
