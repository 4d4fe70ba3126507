"""LeRobot data sets, written as they are documented."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.choice import Choice
from geoskill.io.lerobot import LeRobotEpisode
from geoskill.io.sources import open_frames
from tests.io.lerobot_data import FRONT, WRIST, gray_episodes, write_info, write_pictures_v3, write_v2, write_v3

LENGTHS = (3, 5, 4)


@pytest.fixture(scope="module")
def v3(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_v3(tmp_path_factory.mktemp("v3"), gray_episodes(LENGTHS))


@pytest.fixture(scope="module")
def v2(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_v2(tmp_path_factory.mktemp("v2"), gray_episodes(LENGTHS))


@pytest.mark.parametrize("version", ["v2", "v3"])
@pytest.mark.parametrize("episode", [0, 1, 2])
def test_episode_of_a_video(version: str, episode: int, request: pytest.FixtureRequest) -> None:
    source = open_frames(request.getfixturevalue(version), choice=Choice(episode, FRONT))
    assert isinstance(source, LeRobotEpisode)
    assert source.frame_rate == 10.0
    assert source.name.endswith(f", episode {episode}, {FRONT}")
    for _ in range(2):  # from the first one at each iteration
        frames = list(source)
        assert [frame.index for frame in frames] == list(range(LENGTHS[episode]))
        np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(LENGTHS[episode]) / 10, atol=1e-6)
        grays = [float(frame.image.mean()) for frame in frames]
        np.testing.assert_allclose(grays, 40 * episode + 5 * np.arange(LENGTHS[episode]), atol=2.0)


def test_pictures_in_the_table(tmp_path: Path) -> None:
    folder = write_pictures_v3(tmp_path, gray_episodes((2, 3)))
    frames = list(open_frames(folder, choice=Choice(1, WRIST)))
    assert [(frame.index, int(frame.image[0, 0, 0])) for frame in frames] == [(0, 40), (1, 45), (2, 50)]
    with pytest.raises(InputError, match=rf"has 2 cameras; expected camera=NAME, one of: {FRONT}, {WRIST}"):
        open_frames(folder, choice=Choice(1))


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        (Choice(), r"has 3 episodes; expected episode=NUMBER, from 0 to 2$"),
        (Choice(3, prefix="task."), r"^task\.episode=3: .* has 3 episodes; expected a number from 0 to 2$"),
        (Choice(1, "front"), rf"^camera=front: no camera of .*; expected one of: {FRONT}$"),
        (Choice(1, "observation.images.depth"), "no camera of"),
        (Choice(1, topic="/a"), r"^topic=/a: .* is not a bag of ROS 2 \(MCAP\); expected no topic$"),
    ],
)
def test_choices_that_are_refused(v3: Path, choice: Choice, message: str) -> None:
    with pytest.raises(InputError, match=message):
        open_frames(v3, choice=choice)


def test_choice_of_what_is_no_data_set(demonstration_folder: Path) -> None:
    with pytest.raises(InputError, match=r"^episode=0: .* is not a LeRobot data set; expected no episode$"):
        open_frames(demonstration_folder, choice=Choice(0))
    with pytest.raises(InputError, match=r"^camera=a: 0 is not a LeRobot data set"):
        open_frames(0, choice=Choice(camera="a"))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"codebase_version": "v1.6"}, r'data set of version "v1\.6"; expected 2\.0, 2\.1 or 3\.0'),
        ({"codebase_version": None}, "of version null"),
        ({"fps": "10"}, 'fps is "10"; expected frames per second'),
        ({"fps": 0}, "frame_rate is 0"),
        ({"features": []}, r"features is \[\]"),
        ({"features": {"../../x": {"dtype": "video"}}}, r"camera '\.\./\.\./x' cannot be part of a path"),
        ({"total_episodes": "3"}, 'total_episodes is "3"'),
        ({"chunks_size": 0}, "chunks_size is 0"),
    ],
)
def test_info_that_is_refused(tmp_path: Path, changed: dict[str, Any], message: str) -> None:
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "episodes.jsonl").write_text('{"episode_index": 0, "length": 3}\n')
    features = {FRONT: {"dtype": "video"}}
    write_info(tmp_path, "v2.1", 1, changed.pop("features", features), **changed)
    with pytest.raises(InputError, match=message):
        open_frames(tmp_path)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("{", "not valid JSON"),
        ('{"episode_index": 1, "length": 3}', "length of episode 0 is None"),
        ('{"episode_index": 0, "length": -3}', "length of episode 0 is -3"),
        ('{"episode_index": 0, "length": 3}', r"episode_000000\.mp4: no such file; expected the frames of episode 0"),
    ],
)
def test_episodes_that_are_refused(tmp_path: Path, line: str, message: str) -> None:
    write_info(tmp_path, "v2.1", 1, {FRONT: {"dtype": "video"}})
    (tmp_path / "meta" / "episodes.jsonl").write_text(line)
    with pytest.raises(InputError, match=message):
        open_frames(tmp_path)


def test_missing_frames_are_told(tmp_path: Path) -> None:
    folder = write_v2(tmp_path, gray_episodes((3,)))
    (folder / "meta" / "episodes.jsonl").write_text(json.dumps({"episode_index": 0, "length": 5}))
    with pytest.raises(InputError, match=rf", episode 0, {FRONT}: has 3 frames; expected 5"):
        list(open_frames(folder))
    (folder / "videos" / "chunk-000" / FRONT / "episode_000000.mp4").write_text("version https://git-lfs")
    with pytest.raises(InputError, match=r"episode_000000\.mp4: not readable"):
        list(open_frames(folder))


def test_damaged_tables(tmp_path: Path) -> None:
    write_info(tmp_path, "v3.0", 1, {FRONT: {"dtype": "video"}})
    with pytest.raises(InputError, match="has no episode 0; expected all of the data set"):
        open_frames(tmp_path)
    path = tmp_path / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"PAR1")
    with pytest.raises(InputError, match=r"file-000\.parquet: cannot be read .*; expected Parquet"):
        open_frames(tmp_path)


def test_package_that_is_not_installed(v3: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(InputError, match=r"expected pip install 'geoskill\[datasets\]'$"):
        open_frames(v3, choice=Choice(0))
