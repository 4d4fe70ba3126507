"""Recordings for rerun, read back."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.viz.rerun_log import RECORDING, RerunLog

Command = Callable[..., Any]


def chunks_of(path: Path) -> dict[str, list[Any]]:
    """Everything in a recording, by its entity."""
    from rerun.chunk import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(path).stream():
        found.setdefault(str(chunk.entity_path), []).append(chunk)
    return found


def rows_of(chunks: list[Any]) -> int:
    return sum(chunk.num_rows for chunk in chunks)


@pytest.mark.slow
def test_recording_of_a_run(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    given = [f"skill={skill}", f"video={demonstration_folder}", "inference.abstain=0", "rerun=true"]
    ended = command("infer", *given, f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr) == (0, "")
    assert f"  {RECORDING}" in ended.stdout
    found = chunks_of(tmp_path / RECORDING)
    assert {"/camera", "/camera/features/sift", "/camera/associations/p2p_sift", "/confidence/p2p_sift"} <= found.keys()
    assert {"/error/p2p_sift.x", "/error/p2p_sift.y", "/state/p2p_sift"} <= found.keys()
    assert rows_of(found["/camera"]) == 20
    assert rows_of(found["/camera/features/sift"]) == 20
    assert rows_of(found["/confidence/p2p_sift"]) == 20
    assert 1 <= rows_of(found["/state/p2p_sift"]) <= 20


def test_other_values_are_refused(command: Command, tmp_path: Path) -> None:
    ended = command("infer", "rerun=yes please", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr) == (2, "error: rerun=yes please: expected true, false or live\n")


def test_package_that_is_not_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"^rerun=true: .*expected pip install 'geoskill\[rerun\]'$"):
        RerunLog(tmp_path, live=False, title="a")


def test_depth_lines_and_nothing_selected(tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    from geoskill.features.feature_set import FeatureSet
    from geoskill.geometry.depth_camera import DepthCamera
    from geoskill.geometry.primitives import NodeType
    from geoskill.io.frames import Frame
    from geoskill.skill.association import InferenceResult
    from geoskill.skill.member_status import MemberStatus

    lines = FeatureSet(
        NodeType.LINE,
        np.ones((2, 3), np.float32),
        np.array([[0, 0, 5, 5], [1, 2, 3, 4]], np.float32),
        np.ones(2, np.float32),
    )
    depth = np.full((8, 10), 0.5, np.float32)
    depth[0, 0] = np.nan
    camera = DepthCamera(10.0, 10.0, 5.0, 4.0)
    result = InferenceResult((), {"lbd": lines}, {"l2l_lbd": "none"}, {"l2l_lbd": MemberStatus(("l2l_lbd.1",))})
    with RerunLog(tmp_path, live=False, title="a") as log:
        for index in range(3):
            image = np.full((8, 10, 3), index, np.uint8)
            log.add(Frame(index, index / 10, image, depth, camera), result)
    found = chunks_of(tmp_path / RECORDING)
    assert rows_of(found["/camera/depth"]) == 3
    assert rows_of(found["/camera/features/lbd"]) == 3
    assert rows_of(found["/state/l2l_lbd"]) == 1
    assert not [name for name in found if name.startswith(("/error", "/goal_error", "/confidence"))]
