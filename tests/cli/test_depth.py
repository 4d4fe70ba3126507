"""A folder with depth through the commands: learned from, asked about, and refused without depth."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

Command = Callable[..., Any]


@pytest.fixture
def depth_folder(tmp_path: Path, demonstration_frames: Sequence[np.ndarray]) -> Path:
    """The tiles of the demonstration, all 0.8 m away."""
    folder = tmp_path / "with depth"
    (folder / "depth").mkdir(parents=True)
    for number, frame in enumerate(demonstration_frames):
        cv2.imwrite(str(folder / f"{number:03d}.png"), frame[:, :, ::-1])
        cv2.imwrite(str(folder / "depth" / f"{number:03d}.png"), np.full(frame.shape[:2], 800, np.uint16))
    (folder / "camera.yaml").write_text("fx: 100\nfy: 100\ncx: 79.5\ncy: 59.5\n")
    return folder


@pytest.mark.slow
def test_folder_with_depth_is_learned_from_and_asked_about_in_meters(
    command: Command, tiny: Sequence[str], depth_folder: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    ended = command("train", *tiny, f"task.path={depth_folder}", "kernel=p2p3", f"hydra.run.dir={run}")
    assert ended.status == 0, ended.stderr
    (member,) = yaml.safe_load((run / "skill.yaml").read_text())["members"].values()
    assert (member["kernel"], member["unit"], member["constrains"]) == ("p2p3", "m", 3)
    asked = tmp_path / "asked"
    ended = command("infer", f"skill={run}", f"video={depth_folder}", "inference.abstain=0", f"hydra.run.dir={asked}")
    assert ended.status == 0, ended.stderr
    lines = [json.loads(line) for line in (asked / "associations.jsonl").read_text().splitlines()]
    for line in lines:
        first, second = (np.array(node["xyz_m"]) for node in line["nodes"])
        np.testing.assert_allclose(line["error"], first - second, atol=2e-5)
        assert line["unit"] == "m"
        assert first[2] == pytest.approx(0.8)
    assert (asked / "overlay.mp4").stat().st_size > 0
    refused = command("infer", f"skill={run}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path / 'no'}")
    assert refused.status == 2
    assert refused.stderr.startswith("error: kernel=p2p3 needs depth, and the frame has none; expected a folder with")


def test_training_without_depth_says_what_it_needs(
    command: Command, tiny: Sequence[str], demonstration_folder: Path, tmp_path: Path
) -> None:
    run = tmp_path / "run"
    ended = command("train", *tiny, f"task.path={demonstration_folder}", "kernel=p2p3", f"hydra.run.dir={run}")
    assert ended.status == 2
    (line,) = ended.stderr.splitlines()
    assert line == (
        f"error: kernel=p2p3 needs depth, and {demonstration_folder} has none; expected a folder with depth/ and"
        " camera.yaml beside its pictures, or a simulated task with task.depth=d435"
    )
    assert not (run / "skill.ckpt").exists()
