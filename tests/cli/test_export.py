"""``export=`` of ``infer.py``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

Command = Callable[..., Any]
K = "camera_matrix: {rows: 3, cols: 3, data: [200, 0, 79.5, 0, 200, 59.5, 0, 0, 1]}\n"


@pytest.mark.slow
def test_exports_of_a_recording(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    camera, run = tmp_path / "K.yaml", tmp_path / "run"
    camera.write_text(K, encoding="utf-8")
    wanted = ["export=[ros2,visp,mvtb]", f"intrinsics={camera}", "depth_m=0.5", "inference.abstain=0"]
    ended = command("infer", f"skill={skill}", f"video={demonstration_folder}", *wanted, f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr) == (0, "")
    for name in ("error.mcap", "visp_features.json", "mvtb.npz"):
        assert f"  {name} " in ended.stdout
    lines = [json.loads(line) for line in (run / "associations.jsonl").read_text(encoding="utf-8").splitlines()]
    contents = json.loads((run / "visp_features.json").read_text(encoding="utf-8"))
    assert [frame["frame"] for frame in contents["frames"]] == list(range(20))
    assert contents["camera"] == {"fx": 200.0, "fy": 200.0, "cx": 79.5, "cy": 59.5}
    top = next(line for line in lines if line["rank"] == 1)
    first = contents["frames"][top["frame"]]["features"][0]
    np.testing.assert_allclose(first["s"], top["goal_error"] or top["error"], atol=0.02)
    assert np.shape(first["L"]) == (2, 6)
    assert first["L"][0][0] == pytest.approx(200 / 0.5)
    with np.load(run / "mvtb.npz", allow_pickle=False) as data:
        assert set(data["frame"]) <= set(range(20))
        np.testing.assert_array_equal(data["K"], [[200, 0, 79.5], [0, 200, 59.5], [0, 0, 1]])
        assert set(data["Z"]) == {0.5}
    with (run / "error.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    sizes = summary.statistics.channel_message_counts
    counts = {channel.topic: sizes[number] for number, channel in summary.channels.items()}
    assert counts == {"/geoskill/error": 20, "/geoskill/jacobian": 20, "/geoskill/associations": len(lines)}


@pytest.mark.slow
def test_bad_exports(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    source = [f"skill={skill}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path}"]
    for given, said in (
        (["export=rviz"], "error: export='rviz': expected ros2, visp, mvtb, or several, [ros2,visp]\n"),
        (["export=visp", "intrinsics=none.yaml"], "error: none.yaml: cannot be read"),
        (["export=visp", "depth_m=0"], "error: depth_m=0: expected a number above 0"),
    ):
        ended = command("infer", *source, *given)
        assert ended.status == 2
        assert ended.stderr.startswith(said), ended.stderr
        assert ended.stderr.count("\n") == 1
    assert not (tmp_path / "visp_features.json").exists()
