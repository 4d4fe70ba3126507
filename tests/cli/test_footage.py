"""Frames for the commands, of videos and of simulated recordings; and a skill from one to the other, all simulated."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from omegaconf import DictConfig, OmegaConf

from geoskill.cli import footage
from geoskill.cli.footage import RecordingSource, demonstrations, simulated_footage, video_footage
from geoskill.cli.inputs import open_recording
from geoskill.errors import InputError
from geoskill.io.disk_cache import DiskCache
from geoskill.simulation import scene
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.scene import RecordingSettings

Command = Callable[..., Any]

SORTING = OmegaConf.create({"scene": {"_target_": "geoskill.simulation.tasks.sorting.Sorting"}, "every": 5})
SCREW = OmegaConf.create({"scene": {"_target_": "geoskill.simulation.tasks.screw.Screw"}, "every": 5})


def scenario(**settings: Any) -> DictConfig:
    return OmegaConf.create({"_target_": "geoskill.simulation.conditions.Conditions", "actor": "robot", **settings})


def test_the_frames_of_a_recording(hand_made_recording: Recording) -> None:
    source = RecordingSource(hand_made_recording, "made up, robot")
    assert (source.name, source.frame_rate) == ("made up, robot", 30.0)
    frames = list(source)
    assert [(frame.index, frame.time_s) for frame in frames] == [(0, 0.0), (1, pytest.approx(1 / 30))]
    np.testing.assert_array_equal(frames[1].image, hand_made_recording.picture(1))
    assert [frame.index for frame in source] == [0, 1]  # again from the first


def test_a_video_without_regions_has_no_labels(demonstration_folder: Path) -> None:
    found = video_footage(open_recording(demonstration_folder, None), regions=None, every=5, minimum=3)
    assert (len(found.frames), found.labels, found.recording) == (20, None, None)


def test_several_videos_of_which_the_first_is_labeled(demonstration_folder: Path, tmp_path: Path) -> None:
    labels = {"object": [[1, 1], [9, 1], [9, 9]], "target": [], "hand": []}
    regions = tmp_path / "regions.json"
    regions.write_text(json.dumps({"image_size": [160, 120], "frames": {"0": labels, "19": labels}}))
    task = {"path": [str(demonstration_folder)] * 2, "frame_rate": 10.0, "regions": str(regions), "every": 5}
    cfg = OmegaConf.create({"task": task, "demonstration": {"gap": 2}})
    first, second = demonstrations(cfg, store=None)
    assert (len(first.frames), len(second.frames)) == (20, 20)
    assert second.source.frame_rate == 10.0
    assert first.labels is not None
    assert second.labels is None


@pytest.mark.parametrize("path", [None, {"a": "b"}])
def test_what_is_no_path(path: Any, demonstration_folder: Path) -> None:
    task = {"path": [str(demonstration_folder), path], "frame_rate": None, "regions": None, "every": 5}
    with pytest.raises(InputError, match=r"^task\.path: .+ is no path; expected a folder of images or a video file$"):
        demonstrations(OmegaConf.create({"task": task, "demonstration": {"gap": 2}}), store=None)


def test_a_video_that_is_missing_is_refused_before_any_is_read(demonstration_folder: Path) -> None:
    task = {"path": [str(demonstration_folder), "/no/such.mp4"], "frame_rate": None, "regions": None, "every": 5}
    with pytest.raises(InputError, match=r"^'/no/such\.mp4' does not exist"):
        demonstrations(OmegaConf.create({"task": task, "demonstration": {"gap": 2}}), store=None)


@pytest.fixture
def rendered(hand_made_recording: Recording, monkeypatch: pytest.MonkeyPatch) -> list[RecordingSettings]:
    """What was asked of the renderer, in whose place the hand-made recording is."""
    asked: list[RecordingSettings] = []

    def record(settings: RecordingSettings) -> Recording:
        asked.append(settings)
        return hand_made_recording

    monkeypatch.setattr(scene, "record", record)
    return asked


def test_a_simulated_recording_with_its_labels(rendered: list[RecordingSettings]) -> None:
    found = simulated_footage(SORTING, scenario(occlusion=True, severity=0.5), 7, "occlusion", None)
    assert found.source.name == "sorting, occlusion"
    assert len(found.frames) == 2
    assert found.labels is not None
    labels = found.labels.at(0)
    assert labels is not None
    assert labels.label((12.0, 15.0)) is SceneRole.OBJECT
    assert found.recording is not None
    (settings,) = rendered
    assert (settings.task.name, settings.seed, settings.episode) == ("sorting", 7, "occlusion")
    assert (settings.conditions.actor, settings.conditions.occlusion, settings.conditions.severity) == (
        "robot",
        True,
        0.5,
    )


def test_several_takes_of_the_same_things(rendered: list[RecordingSettings]) -> None:
    cfg = {"task": {**SORTING, "takes": 3}, "scenario": scenario(), "seed": 7}
    found = list(demonstrations(OmegaConf.create(cfg), store=None))
    assert [each.source.name for each in found] == [f"sorting, demonstration{number}" for number in ("", " 2", " 3")]
    assert [(each.seed, each.episode) for each in rendered] == [
        (7, "demonstration"),
        (7, "demonstration 2"),
        (7, "demonstration 3"),
    ]


def test_it_is_rendered_once_for_the_same_settings_and_code(
    rendered: list[RecordingSettings], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ask(task: DictConfig = SORTING, seed: int = 0, take: str = "robot", **settings: Any) -> None:
        found = simulated_footage(task, scenario(**settings), seed, take, DiskCache(tmp_path))
        assert len(found.frames) == 2

    ask()
    ask()
    assert len(rendered) == 1
    others: Sequence[Mapping[str, Any]] = (
        {"task": SCREW},
        {"seed": 1},
        {"take": "human"},
        {"actor": "human"},
        {"severity": 0.5},
        {"occlusion": True},
    )
    for number, other in enumerate(others, start=2):
        ask(**other)
        ask(**other)
        assert len(rendered) == number, other
    monkeypatch.setattr(footage, "_renderer_identity", lambda: "other code")
    ask()
    assert len(rendered) == len(others) + 2


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_a_skill_learned_and_scored_in_simulation(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    small = [override for override in tiny if not override.startswith("task")]
    run = tmp_path / "run"
    trained = command("train", "task=sorting", "task.every=20", "seed=3", *small, f"hydra.run.dir={run}")
    assert (trained.status, trained.stderr, trained.folder) == (0, "", run)
    figures = json.loads((run / "metrics.json").read_text())
    assert 80 <= figures["frames"] <= 110
    assert figures["judged_frames"] == -(-figures["frames"] // 20)
    assert figures["steps"] == 6
    assert (run / "overlay.mp4").stat().st_size > 0
    stored = torch.load(run / "skill.ckpt", weights_only=True)["skill"]
    learned_from = stored["learned_from"]
    assert (learned_from["task"], learned_from["seed"], learned_from["scenario"]["actor"]) == ("sorting", 3, "human")

    scored = tmp_path / "scored"
    arguments = [f"skill={run / 'skill.ckpt'}", "task=sorting", "scenario=occlusion", "every=15"]
    ended = command("evaluate", *arguments, f"hydra.run.dir={scored}")
    assert (ended.status, ended.stderr, ended.folder) == (0, "", scored)
    figures = json.loads((scored / "metrics.json").read_text())
    contract = {"frames", "feasible_frames", "top1_accuracy", "hand_rate", "mean_confidence", "rsw"}
    new = {"strict_accuracy", "strictly_feasible_frames", "goal_error_mm", "error_autocorrelation"}
    new |= {"oracle_strict_accuracy", "oracle_goal_error_mm"}
    assert contract | {"switches_per_frame"} | new | {"baseline_success", "baseline_pairs"} <= figures.keys()
    assert figures["video"] == "sorting, occlusion"
    assert 0 < figures["strictly_feasible_frames"] <= figures["feasible_frames"] <= figures["frames"] <= 8
    assert figures["unlabeled_frames"] == 0
    assert 0 <= figures["baseline_pairs"][0] <= figures["baseline_pairs"][1] <= 10
    with (scored / "verdicts.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == [15 * number for number in range(figures["frames"])]
    assert {row["strict"] for row in rows} <= {"True", "False"}
    for row in rows:  # strictly right is right, and within 3 mm
        if row["strict"] == "True":
            assert row["correct"] == "True"
            assert float(row["goal_error_mm"]) <= 3

    # Without a word, the things are those of the demonstration.
    again = command("evaluate", *arguments, "seed=3", f"hydra.run.dir={tmp_path / 'again'}")
    assert (again.folder / "verdicts.csv").read_text() == (scored / "verdicts.csv").read_text()
