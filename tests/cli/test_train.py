"""``python train.py`` from the command line to the files of its run."""

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
import torch
import yaml

from geoskill.skill.checkpoint import read_skill

Command = Callable[..., Any]

FRAMES = 20
NODE_TYPES = {"p2p": ["point", "point"], "l2l": ["line", "line"], "p2l": ["point", "line"], "par": ["line", "line"]}
ERROR_DIMENSIONS = {"p2p": 2, "l2l": 2, "p2l": 1, "par": 1}


def associations(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "associations.jsonl").read_text(encoding="utf-8").splitlines()]


def check_associations(lines: Sequence[dict[str, Any]], frame_count: int, frame_rate: float = 30.0) -> None:
    """Every frame is there for every member, in order, with ranks from 1 on, by falling weight from 2 on."""
    members = list(dict.fromkeys((line["kernel"], line["descriptor"]) for line in lines))
    assert list(dict.fromkeys(line["frame"] for line in lines)) == list(range(frame_count))
    for frame in range(frame_count):
        for kernel, descriptor in members:
            own = [line for line in lines if (line["frame"], line["kernel"]) == (frame, kernel)]
            own = [line for line in own if line["descriptor"] == descriptor]
            assert [line["rank"] for line in own] == list(range(1, len(own) + 1))
            assert 1 <= len(own) <= 10
            weights = [line["weight"] for line in own]
            assert weights[1:] == sorted(weights[1:], reverse=True)
            # A kept association that was not detected has the weight of an earlier frame.
            assert sum(weights[1:]) <= 1 + 1e-5
            assert all(0 <= line["confidence"] <= 1 and 0 < line["weight"] <= 1 for line in own)
            for line in own:
                assert line["time_s"] == pytest.approx(frame / frame_rate, abs=1e-5)
                assert [node["type"] for node in line["nodes"]] == NODE_TYPES[kernel]
                shapes = {"point": (2,), "line": (2, 2)}
                assert all(np.shape(node["xy"]) == shapes[node["type"]] for node in line["nodes"])
                assert np.shape(line["error"]) == (ERROR_DIMENSIONS[kernel],)


def check_video(path: Path, frame_count: int) -> None:
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.codec_context.name == "h264"
        decoded = list(container.decode(stream))
    assert len(decoded) == frame_count


def test_files_of_a_run(trained: Any) -> None:
    folder = trained.folder
    assert trained.stderr == ""
    assert folder.is_absolute()
    lines = associations(folder)
    check_associations(lines, FRAMES)
    # A point's error is the difference of the two, in pixels of the frame.
    for line in lines:
        (x1, y1), (x2, y2) = (node["xy"] for node in line["nodes"])
        assert line["error"] == pytest.approx([x1 - x2, y1 - y2], abs=2e-3)
        assert -1 <= min(x1, x2) <= max(x1, x2) <= 161
    check_video(folder / "overlay.mp4", FRAMES)

    for name in ("training.png", "inference.png"):
        assert cv2.imread(str(folder / name)) is not None
    with (folder / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["step"]) for row in rows] == [1, 2, 3, 4, 5, 6]
    assert [int(row["epoch"]) for row in rows] == [0, 0, 0, 1, 1, 1]
    for metric in ("objective", "reward", "rsw", "error"):
        assert all(np.isfinite(float(row[f"p2p_sift/{metric}"])) for row in rows)

    figures = json.loads((folder / "metrics.json").read_text())
    assert figures["frames"] == figures["frames_with_association"] == FRAMES
    assert figures["steps"] == 6
    top = [line["confidence"] for line in lines if line["rank"] == 1]
    assert figures["mean_confidence"] == pytest.approx(np.mean(top), abs=1e-5)
    assert np.isfinite(figures["objective"])
    assert 0 <= figures["rsw"] <= 1
    evidence = figures["evidence"]["p2p_sift"]
    assert figures["found"] is evidence["found"] is (evidence["approached"] >= 0.5)

    definition = yaml.safe_load((folder / "skill.yaml").read_text())
    assert definition["degrees_of_freedom"] == 2
    member = definition["members"]["p2p_sift"]
    assert (member["kernel"], member["descriptor"], member["frames"]) == ("p2p", "sift", FRAMES)
    assert member["learned"] == evidence
    assert figures["phases"] == definition["phases"]  # none where nothing came together
    assert all(phase["members"] == list(phase["until"]) == ["p2p_sift"] for phase in definition["phases"])
    assert "auto" not in definition
    assert 0 < sum(entry["share"] for entry in member["associations"]) <= 1.0001

    checkpoint = torch.load(folder / "skill.ckpt", weights_only=True)
    assert list(checkpoint["skill"]["specification"]["members"]) == ["p2p_sift"]
    assert checkpoint["skill"]["provenance"]["finished"] is True
    assert checkpoint["skill"]["provenance"]["epochs"] == [2, 2]
    assert {"optimizer_states", "loops", "callbacks"} <= checkpoint.keys()  # to resume from
    assert checkpoint["state_dict"]["members.p2p_sift.beta"].gt(0).any()
    assert checkpoint["state_dict"]["members.p2p_sift.reference_margin"] > 0
    assert (folder / ".hydra" / "overrides.yaml").is_file()
    assert not list(folder.glob("*.part")) + list(folder.glob(".*partial*"))


@pytest.mark.slow
def test_seed_makes_a_run_repeatable(command: Command, tiny: Sequence[str], trained: Any, tmp_path: Path) -> None:
    again = command("train", *tiny, f"hydra.run.dir={tmp_path / 'again'}")
    other = command("train", *tiny, "seed=1", f"hydra.run.dir={tmp_path / 'other'}")
    assert (again.status, other.status) == (0, 0)
    assert associations(again.folder) == associations(trained.folder)
    assert associations(other.folder) != associations(trained.folder)


@pytest.mark.slow
def test_member_of_an_ensemble_learns_what_it_learns_alone(
    command: Command, tiny: Sequence[str], trained: Any, tmp_path: Path
) -> None:
    together = command("train", *tiny, "descriptor=[orb,sift]", f"hydra.run.dir={tmp_path}")
    assert together.status == 0, together.stderr
    alone, both = (
        torch.load(ended.folder / "skill.ckpt", weights_only=True)["state_dict"] for ended in (trained, together)
    )
    assert list(dict.fromkeys(key.split(".")[1] for key in both)) == ["p2p_orb", "p2p_sift"]
    for key, weight in alone.items():
        assert torch.equal(both[key], weight), key


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kernel", "members", "freedoms"),
    [
        ("p2l", {"p2l_sift_lbd"}, 1),
        ("par", {"par_lbd"}, 1),
        ("p2p_l2l", {"p2p_sift", "l2l_lbd"}, 4),
    ],
)
def test_kernels_and_ensembles(
    command: Command, tiny: Sequence[str], tmp_path: Path, kernel: str, members: set[str], freedoms: int
) -> None:
    ended = command("train", *tiny, f"kernel={kernel}", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    check_associations(associations(tmp_path), FRAMES)
    definition = yaml.safe_load((tmp_path / "skill.yaml").read_text())
    assert set(definition["members"]) == members
    assert definition["degrees_of_freedom"] == freedoms
    checkpoint = torch.load(tmp_path / "skill.ckpt", weights_only=True)
    assert set(checkpoint["skill"]["specification"]["members"]) == members


@pytest.mark.slow
def test_kernels_that_the_demonstration_chooses(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    ended = command("train", *tiny, "kernel=auto", "descriptor=[sift,lbd]", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    definition = yaml.safe_load((tmp_path / "skill.yaml").read_text())
    choice = definition["auto"]
    assert json.loads((tmp_path / "metrics.json").read_text())["auto"] == choice
    assert choice["kept"] == list(definition["members"])
    assert {own.partition("_")[0] for own in (*choice["kept"], *choice["dropped"])} == {"p2p", "p2l", "l2l", "par"}
    assert f"kept: {', '.join(choice['kept'])}" in ended.stdout
    assert all(f"dropped {name}: {reason}" in ended.stdout for name, reason in choice["dropped"].items())


@pytest.mark.slow
def test_paper_experiment(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    # The choices of `tiny` win over those of the experiment: a small network, and three transitions an epoch.
    ended = command("train", *tiny, "experiment=paper", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr) == (0, "")
    check_associations(associations(tmp_path), FRAMES)
    assert json.loads((tmp_path / "metrics.json").read_text())["steps"] == 6


@pytest.mark.slow
def test_message_passing(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    ended = command("train", *tiny, "model=default", "model.hidden_dim=8", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr) == (0, "")
    check_associations(associations(tmp_path), FRAMES)


@pytest.mark.slow
def test_resumed_training_equals_an_unbroken_one(
    command: Command, tiny: Sequence[str], trained: Any, tmp_path: Path
) -> None:
    one = command("train", *tiny, "trainer.max_epochs=1", f"hydra.run.dir={tmp_path / 'one'}")
    two = command("train", *tiny, f"ckpt_path={one.folder / 'skill.ckpt'}", f"hydra.run.dir={tmp_path / 'two'}")
    assert (two.status, two.stderr) == (0, "")
    assert associations(one.folder) != associations(trained.folder)
    assert associations(two.folder) == associations(trained.folder)
    assert (two.folder / "metrics.csv").read_text() == (trained.folder / "metrics.csv").read_text()


@pytest.mark.slow
def test_training_is_scored_on_labeled_frames(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    everywhere = [[0, 0], [160, 0], [160, 120], [0, 120]]
    regions = tmp_path / "regions.json"
    frame = {"object": everywhere, "target": [], "hand": []}
    content = {"image_size": [160, 120], "frames": {"0": frame, str(FRAMES - 1): frame}}
    regions.write_text(json.dumps(content))
    run = tmp_path / "run"
    ended = command("train", *tiny, f"task.regions={regions}", "task.every=10", f"hydra.run.dir={run}")
    assert ended.status == 0, ended.stderr
    figures = json.loads((run / "metrics.json").read_text())
    assert figures["feasible_frames"] == 0  # both points of every association are on the object
    assert figures["evaluated_frames"] == 2
    assert figures["frames"] == figures["frames_with_association"] == FRAMES


@pytest.mark.slow
def test_several_videos_are_learned_from_and_the_first_is_shown(
    command: Command, tiny: Sequence[str], trained: Any, tmp_path: Path
) -> None:
    first = Path(tiny[1].removeprefix("task.path="))
    second = tmp_path / "second"
    second.mkdir()
    for path in sorted(first.iterdir())[: FRAMES // 2]:
        cv2.imwrite(str(second / path.name), cv2.imread(str(path))[:, ::-1])
    run = tmp_path / "run"
    both, unlimited = f"task.path=[{first},{second}]", "demonstration.max_visible_features=null"
    ended = command("train", *tiny, both, unlimited, f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr) == (0, "")
    assert list(dict.fromkeys(line["frame"] for line in associations(run))) == list(range(FRAMES))
    check_video(run / "overlay.mp4", FRAMES)
    # It has learned from both, and goes on with both only.
    assert (run / "metrics.csv").read_text() != (trained.folder / "metrics.csv").read_text()
    assert read_skill(run).provenance.sources == (str(first), str(second))
    longer = [unlimited, f"ckpt_path={run / 'skill.ckpt'}", "trainer.max_epochs=3"]
    resumed = command("train", *tiny, *longer, f"hydra.run.dir={run}")
    assert resumed.status == 2
    assert "learned from 2 demonstration(s); expected 1, as this run" in resumed.stderr


@pytest.mark.slow
def test_black_frames_have_a_reason(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    source = Path(tiny[1].removeprefix("task.path="))
    demonstration = tmp_path / "demonstration"
    demonstration.mkdir()
    for path in source.iterdir():
        image = cv2.imread(str(path))
        cv2.imwrite(str(demonstration / path.name), 0 * image if path.stem in ("000", "007") else image)
    run = tmp_path / "run"
    ended = command("train", *tiny, f"task.path={demonstration}", f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr) == (0, "")
    lines = associations(run)
    assert list(dict.fromkeys(line["frame"] for line in lines)) == list(range(FRAMES))
    empty = [line for line in lines if line["frame"] in (0, 7)]
    assert [line["frame"] for line in empty] == [0, 7]
    assert empty[1] == {
        "frame": 7,
        "time_s": pytest.approx(7 / 30, abs=1e-5),
        "kernel": "p2p",
        "descriptor": "sift",
        "rank": 0,
        "confidence": 0.0,
        "nodes": [],
        "error": [],
        "error_std": [],
        "state": "lost",
        "error_available": [False, False],
        "goal_error_available": [False, False],
        "agreement": None,
        "switched": False,
        "offset_px": None,
        "reason": "no instance: 0 points found",
    }
    check_video(run / "overlay.mp4", FRAMES)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "overrides"), [(3, ()), (4, ()), (20, ("demonstration.gap=18",)), (20, ("demonstration.gap=19",))]
)
def test_few_frames_and_long_gaps(
    command: Command, tiny: Sequence[str], tmp_path: Path, frames: int, overrides: Sequence[str]
) -> None:
    """As few transitions as there can be, one or two, over up to the whole demonstration."""
    source = Path(tiny[1].removeprefix("task.path="))
    demonstration = tmp_path / "demonstration"
    demonstration.mkdir()
    for path in sorted(source.iterdir())[:frames]:
        (demonstration / path.name).write_bytes(path.read_bytes())
    given = [*tiny, f"task.path={demonstration}", *overrides, f"hydra.run.dir={tmp_path / 'run'}"]
    ended = command("train", *given)
    if overrides:  # nothing can be followed that far
        assert (ended.status, len(ended.stderr.splitlines())) == (2, 1)
        assert "nothing moves in the demonstration" in ended.stderr
    else:
        assert (ended.status, ended.stderr) == (0, "")
        assert json.loads((tmp_path / "run" / "metrics.json").read_text())["frames"] == frames
