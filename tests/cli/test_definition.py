"""``definition=`` of ``infer.py`` and ``evaluate.py``: an edited task definition is obeyed, or refused in one line."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from tests.cli.test_evaluate import write_regions

Command = Callable[..., Any]


def edited(trained: Any, path: Path, old: str, new: str) -> Path:
    text = (trained.folder / "skill.yaml").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def test_definition_shows_what_is_moved_and_what_rests(trained: Any) -> None:
    text = (trained.folder / "skill.yaml").read_text()
    assert "# What a skill has learned. A copy of this file can be edited" in text
    definition = yaml.safe_load(text)
    member = definition["members"]["p2p_sift"]
    assert member["sentence"].startswith("Nothing was learned: ")  # in six steps
    assert definition["task"] == "Nothing was learned from the demonstration."
    for association in member["associations"]:
        for node in association["nodes"]:
            picture = cv2.imread(str(trained.folder / node["picture"]))
            assert picture.shape == (210, 210, 3)  # 7 times a quarter of 120
            assert Path(node["picture"]).name == f"p2p_sift-{association['number']}-{node['role']}.png"


@pytest.mark.slow
def test_infer_obeys_a_pin(command: Command, trained: Any, demonstration_folder: Path, tmp_path: Path) -> None:
    pinned = edited(trained, tmp_path / "a definition, edited.yaml", "pin: null", "pin: 1")
    run = tmp_path / "run"
    source = (f"skill={trained.folder}", f"video={demonstration_folder}", "inference.abstain=0")
    ended = command("infer", *source, f"definition={pinned}", "inference.temporal=none", f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr) == (0, "")
    definition = yaml.safe_load((trained.folder / "skill.yaml").read_text())
    best = definition["members"]["p2p_sift"]["associations"][0]
    lines = [json.loads(line) for line in (run / "associations.jsonl").read_text().splitlines()]
    reasons = {line["reason"] for line in lines if line["rank"] == 0}
    assert reasons <= {"the pinned association is not visible"}
    (own,) = (line for line in lines if line["frame"] == best["seen_best_in_frame"] and line["rank"] == 1)
    assert [node["xy"] for node in own["nodes"]] == [node["xy"] for node in best["nodes"]]


@pytest.mark.parametrize("name", ["infer", "evaluate"])
def test_bad_edit_is_refused_in_one_line(
    command: Command, trained: Any, demonstration_folder: Path, tmp_path: Path, name: str
) -> None:
    bad = edited(trained, tmp_path / "edited.yaml", "kernel: p2p", "kernel: l2l")
    line = bad.read_text().splitlines().index("    kernel: l2l") + 1
    regions = [f"regions={write_regions(tmp_path / 'regions.json', True)}"] if name == "evaluate" else []
    source = (f"skill={trained.folder}", f"video={demonstration_folder}", *regions)
    ended = command(name, *source, f"definition={bad}", f"hydra.run.dir={tmp_path / 'run'}")
    expected = "members.p2p_sift.kernel is 'l2l'; expected 'p2p', as it was learned"
    assert (ended.status, ended.stderr) == (2, f"error: {bad} line {line}: {expected}\n")
    assert not (tmp_path / "run" / "metrics.json").exists()


@pytest.mark.slow
def test_evaluate_obeys_a_definition(
    command: Command, trained: Any, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    """From the middle on, everything looks otherwise; without a pin something is selected all the same."""
    video = tmp_path / "video"
    video.mkdir()
    other = np.full((120, 160, 3), 128, np.uint8)
    for x in (40, 80, 120):  # smooth blobs, which look like no corner of a pattern
        cv2.circle(other, (x, 40 + x // 4), 10, (200, 60, 60), -1, cv2.LINE_AA)
    other = np.asarray(cv2.GaussianBlur(other, (0, 0), 3), np.uint8)
    for number, frame in enumerate(demonstration_frames):
        cv2.imwrite(str(video / f"{number:03d}.png"), (frame if number < 10 else other)[:, :, ::-1])
    regions = write_regions(tmp_path / "regions.json", True)
    source = (f"skill={trained.folder}", f"video={video}", f"regions={regions}", "every=5")
    pinned = edited(trained, tmp_path / "edited.yaml", "pin: null", "pin: 1")
    selected = []
    for number, further in enumerate(((), (f"definition={pinned}",))):
        run = tmp_path / str(number)
        ended = command("evaluate", *source, *further, "inference.temporal=none", f"hydra.run.dir={run}")
        assert ended.status == 0, ended.stderr
        with (run / "frames.csv").open(newline="") as file:
            selected.append([row["has_association"] == "True" for row in csv.DictReader(file)])
    assert selected == [[True] * 4, [True, True, False, False]]
