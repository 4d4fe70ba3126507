"""Labeled sequences of the commands, from videos and simulated recordings; learning and scoring in simulation."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.cli import sequences
from geoskill.cli.inputs import open_recording
from geoskill.cli.schemas import RegionsConfig, SimulatedTaskConfig, TrainCommandConfig, VideoTaskConfig
from geoskill.cli.sequences import RecordingSource, labeled_demonstrations, labeled_recording, labeled_video
from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.io.disk_cache import DiskCache
from geoskill.simulation import scene
from geoskill.simulation.depth_sensor import recorded_depth
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.scene import RecordingSettings
from geoskill.skill.checkpoint import SimulatedScene, read_skill

Command = Callable[..., Any]


def scene_of(task: str = "sorting", seed: int = 0, **scenario: Any) -> SimulatedScene:
    return SimulatedScene(task, seed, ScenarioConfig(**{"actor": "robot", **scenario}))


def test_recording_source_yields_its_frames(hand_made_recording: Recording) -> None:
    source = RecordingSource(hand_made_recording, "made up, robot")
    assert (source.name, source.frame_rate) == ("made up, robot", 30.0)
    frames = list(source)
    assert [(frame.index, frame.time_s) for frame in frames] == [(0, 0.0), (1, pytest.approx(1 / 30))]
    np.testing.assert_array_equal(frames[1].image, hand_made_recording.picture(1))
    assert [frame.index for frame in source] == [0, 1]  # again from the first


def test_recording_source_yields_depth_where_a_sensor_is_chosen(hand_made_recording: Recording) -> None:
    assert all(frame.depth_m is None for frame in RecordingSource(hand_made_recording, "robot"))
    first, second = RecordingSource(hand_made_recording, "robot", depth="d435", seed=1, episode="robot")
    assert first.depth_camera is not None
    assert (first.depth_camera.focal_x_px, first.depth_camera.center_x_px) == (80.0, 20.0)
    assert first.depth_camera.noise_per_m == pytest.approx(0.08 / (436 * 0.05))
    assert first.depth_m is not None
    # The table at 1 m, far from an edge.
    assert first.depth_m[2, 2] == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(second.depth_m, recorded_depth(hand_made_recording, 1, "d435", 1, "robot"))


def test_video_without_regions_has_no_labels(demonstration_folder: Path) -> None:
    sequence = labeled_video(open_recording(demonstration_folder, None), regions=RegionsConfig(), every=5, minimum=3)
    assert (len(sequence.frames), sequence.labels, sequence.recording) == (20, None, None)


def demonstrations_of(task: VideoTaskConfig) -> Any:
    return labeled_demonstrations(TrainCommandConfig(task=task), store=None)


def test_first_of_several_videos_is_labeled(demonstration_folder: Path, tmp_path: Path) -> None:
    labels = {"object": [[1, 1], [9, 1], [9, 9]], "target": [], "hand": []}
    regions = tmp_path / "regions.json"
    regions.write_text(json.dumps({"image_size": [160, 120], "frames": {"0": labels, "19": labels}}))
    task = VideoTaskConfig(
        path=[str(demonstration_folder)] * 2, frame_rate=10.0, regions=RegionsConfig(path=str(regions))
    )
    first, second = demonstrations_of(task)
    assert (len(first.frames), len(second.frames)) == (20, 20)
    assert second.source.frame_rate == 10.0
    assert first.labels is not None
    assert second.labels is None


def test_parts_of_recordings(demonstration_folder: Path) -> None:
    path = str(demonstration_folder)
    task = VideoTaskConfig(path=path, start=[0, "10f"], end=["8f", 0.6], stride=2)
    first, second = demonstrations_of(task)
    assert first.source.name == f"{path} (from 0 s, to frame 8, every 2 frames)"
    assert (len(first.frames), len(second.frames)) == (4, 4)  # frames 0, 2, 4, 6 and 10, 12, 14, 16
    assert second.source.frame_rate == 15.0
    whole = list(open_recording(path, None))
    np.testing.assert_array_equal(second.frames[1].image, whole[12].image)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"start": [1, 2, 3]}, r"^task\.path: there are 2; expected one, or 3 as of the others$"),
        ({"end": "1 minute"}, r"^task\.end=1 minute: expected seconds, such as 2\.5, or frames, such as 75f$"),
        (
            {"start": 1, "regions": RegionsConfig(path="a.json")},
            r"^task\.regions=a\.json: numbers the frames of the",
        ),
        ({"start": 0.6}, r"\(from 0\.6 s\): 2 frame\(s\); expected at least 3$"),
    ],
)
def test_parts_that_do_not_fit(demonstration_folder: Path, settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        list(demonstrations_of(VideoTaskConfig(path=[str(demonstration_folder)] * 2, **settings)))


@pytest.mark.parametrize("path", [None, {"a": "b"}, True, 1.5, ["a"]])
def test_paths_of_a_wrong_type(path: Any, demonstration_folder: Path) -> None:
    with pytest.raises(InputError, match=r"^task\.path: .+ is no path; expected a folder of images or a video file$"):
        demonstrations_of(VideoTaskConfig(path=[str(demonstration_folder), path]))


def test_missing_video_is_refused_before_any_is_read(demonstration_folder: Path) -> None:
    with pytest.raises(InputError, match=r"^'/no/such\.mp4' does not exist"):
        demonstrations_of(VideoTaskConfig(path=[str(demonstration_folder), "/no/such.mp4"]))


@pytest.fixture
def rendered(hand_made_recording: Recording, monkeypatch: pytest.MonkeyPatch) -> list[RecordingSettings]:
    """What was asked of the renderer, in whose place the hand-made recording is."""
    asked: list[RecordingSettings] = []

    def record(settings: RecordingSettings) -> Recording:
        asked.append(settings)
        return hand_made_recording

    monkeypatch.setattr(scene, "record", record)
    return asked


def test_labeled_recording(rendered: list[RecordingSettings]) -> None:
    sequence = labeled_recording(scene_of(seed=7, occlusion=True, severity=0.5), "occlusion", None)
    assert sequence.source.name == "sorting, occlusion"
    assert len(sequence.frames) == 2
    assert sequence.labels is not None
    labels = sequence.labels.at(0)
    assert labels is not None
    assert labels.label((12.0, 15.0)) is SceneRole.OBJECT
    assert sequence.recording is not None
    (settings,) = rendered
    assert (settings.task.name, settings.seed, settings.episode) == ("sorting", 7, "occlusion")
    conditions = settings.scenario
    assert (conditions.actor, conditions.occlusion, conditions.severity) == ("robot", True, 0.5)


def test_several_demonstrations_are_episodes_of_the_same_scene(rendered: list[RecordingSettings]) -> None:
    task = SimulatedTaskConfig("sorting", num_demonstrations=3)
    config = TrainCommandConfig(task=task, scenario=ScenarioConfig(actor="robot"), seed=7)
    episodes = ["demonstration", "demonstration 2", "demonstration 3"]
    labeled = list(labeled_demonstrations(config, store=None))
    assert [sequence.source.name for sequence in labeled] == [f"sorting, {episode}" for episode in episodes]
    assert [(settings.seed, settings.episode) for settings in rendered] == [(7, episode) for episode in episodes]


def test_recording_is_rendered_once_for_the_same_settings_and_code(
    rendered: list[RecordingSettings], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def ask(episode: str = "robot", **settings: Any) -> None:
        sequence = labeled_recording(scene_of(**settings), episode, DiskCache(tmp_path))
        assert len(sequence.frames) == 2

    ask()
    ask()
    assert len(rendered) == 1
    others: Sequence[Mapping[str, Any]] = (
        {"task": "screw"},
        {"seed": 1},
        {"episode": "human"},
        {"actor": "human"},
        {"severity": 0.5},
        {"occlusion": True},
    )
    for number, other in enumerate(others, start=2):
        ask(**other)
        ask(**other)
        assert len(rendered) == number, other
    monkeypatch.setattr(sequences, "_renderer_identity", lambda: "other code")
    ask()
    assert len(rendered) == len(others) + 2


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_skill_is_learned_and_scored_in_simulation(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    small = [override for override in tiny if not override.startswith("task")]
    run = tmp_path / "run"
    trained = command("train", "task=sorting", "task.every=20", "seed=3", *small, f"hydra.run.dir={run}")
    assert (trained.status, trained.stderr, trained.folder) == (0, "", run)
    figures = json.loads((run / "metrics.json").read_text())
    assert 80 <= figures["frames"] <= 110
    assert figures["evaluated_frames"] == -(-figures["frames"] // 20)
    assert figures["steps"] == 6
    assert (run / "overlay.mp4").stat().st_size > 0
    assert read_skill(run).provenance.scene == SimulatedScene("sorting", 3, ScenarioConfig())

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
    with (scored / "frames.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["frame"]) for row in rows] == [15 * number for number in range(figures["frames"])]
    assert {row["strict"] for row in rows} <= {"True", "False"}
    for row in rows:  # strictly right is right, and within 3 mm
        if row["strict"] == "True":
            assert row["correct"] == "True"
            assert float(row["goal_error_mm"]) <= 3

    # Without a seed, the things are those of the demonstration.
    again = command("evaluate", *arguments, "seed=3", f"hydra.run.dir={tmp_path / 'again'}")
    assert (again.folder / "frames.csv").read_text() == (scored / "frames.csv").read_text()
