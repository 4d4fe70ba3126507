"""Several videos by one command: a run for each, and one table."""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.cli.videos import with_each_video, write_rows
from tests.cli.test_infer import write_video

Command = Callable[..., Any]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        (["skill=R", "video=a.mp4"], ["skill=R", "video=a.mp4"]),
        (["skill=R", "video=0"], ["skill=R", "video=0"]),
        (["video=[a.mp4]"], ["video=a.mp4"]),
        (["-m", "video=[a,b]"], ["-m", "video=[a,b]"]),
        (["--help"], ["--help"]),
        (["video=[a,b]"], ["-m", "video=a,b", "hydra/launcher=joblib", "threads=1"]),
        (
            ["video=[a,b]", "hydra/launcher=submitit_slurm", "hydra.run.dir=x"],
            ["-m", "video=a,b", "hydra/launcher=submitit_slurm", "hydra.sweep.dir=x", "threads=1"],
        ),
    ],
)
def test_several_videos_are_a_sweep(given: Sequence[str], expected: Sequence[str]) -> None:
    assert with_each_video(given) == list(expected)


def test_folder_of_videos_and_folder_of_pictures(tmp_path: Path) -> None:
    for name in ("b.mp4", "a.MOV", "notes.txt", ".hidden.mp4"):
        (tmp_path / name).touch()
    swept = with_each_video([f"video={tmp_path}"])
    assert swept[:2] == ["-m", f"video={tmp_path / 'a.MOV'},{tmp_path / 'b.mp4'}"]
    (tmp_path / "0.png").touch()  # pictures, beside which a recording of them may lie
    assert with_each_video([f"video={tmp_path}"]) == [f"video={tmp_path}"]


def test_table_has_a_row_for_each_video(tmp_path: Path) -> None:
    rows = [
        {"video": "a.mp4", "frames": 20, "mean_confidence": 0.25, "error": None},
        {"video": "b.mp4", "frames": None, "mean_confidence": None, "error": "b.mp4: no such file"},
    ]
    write_rows(rows, tmp_path)
    lines = [" ".join(line.split()) for line in (tmp_path / "summary.md").read_text().splitlines()]
    assert lines[2:] == ["| a.mp4 | 20 | 0.250 | |", "| b.mp4 | | | b.mp4: no such file |"]
    assert json.loads((tmp_path / "summary.json").read_text()) == rows


@pytest.mark.slow
def test_a_folder_of_videos_of_which_one_is_damaged(
    script: Command, skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    videos, run = tmp_path / "videos", tmp_path / "run"
    videos.mkdir()
    write_video(videos / "one, two.mp4", demonstration_frames)
    shutil.copy(videos / "one, two.mp4", videos / "three.mp4")
    (videos / "x.mp4").write_bytes(b"no video")
    ended = script("infer", f"skill={skill}", f"video={videos}", f"hydra.run.dir={run}", "report=false")
    assert (ended.status, ended.folder) == (2, run), ended.stderr
    assert ended.stderr.startswith(
        f"error: 1 run(s) failed, first {videos / 'x.mp4'}: {videos / 'x.mp4'}: not readable"
    )
    rows = json.loads((run / "summary.json").read_text())
    assert [(Path(row["video"]).name, row["run"], row["frames"]) for row in rows] == [
        ("one, two.mp4", "0", 20),
        ("three.mp4", "1", 20),
        ("x.mp4", "2", None),
    ]
    assert (run / "0" / "associations.jsonl").read_bytes() == (run / "1" / "associations.jsonl").read_bytes()
