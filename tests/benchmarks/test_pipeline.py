"""The command ``python -m geoskill.benchmarks.pipeline``, on a small video and on bad input."""

import json
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geoskill.benchmarks.measurement import single_runs
from geoskill.benchmarks.rates import relative_rate
from geoskill.benchmarks.stages import EXTRACT, OVERLAPPED, Stages
from geoskill.io.image_folder import ImageFolder
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec

WORKLOADS = ["read", "extract", "extract, 2 at once", "select", "all, in turn", "all, overlapped"]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "geoskill.benchmarks.pipeline", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_pipeline_writes_table_json_and_plot(demonstration_folder: Path, tmp_path: Path) -> None:
    small = ("model.hidden_dim=8", "model.prototypes=5", "features.min_side=0", "features.max_features=10")
    arguments = (f"video={demonstration_folder}", "frames=3", "repeats=2", "threads=2")
    process = run(*small, *arguments, f"hydra.run.dir={tmp_path}")
    assert (process.returncode, process.stderr) == (0, "")
    content = json.loads((tmp_path / "pipeline.json").read_text())
    assert (content["source"], content["frames"]) == (str(demonstration_folder), 3)
    assert (content["image_size"], content["machine"]["threads"]) == ([160, 120], 2)
    assert content["skill"]["model"]["arguments"]["hidden_dim"] == 8
    assert list(content["workloads"]) == WORKLOADS
    for rates in content["workloads"].values():
        assert len(rates["seconds"]) == 2
        assert rates["frames_per_second"] == pytest.approx(3 / (sum(rates["seconds"]) / 2))
    assert content["workloads"]["extract"]["over_extract"] == 1
    table = (tmp_path / "pipeline.md").read_text()
    assert table in process.stdout
    assert [line.split(" | ")[0].removeprefix("| ") for line in table.splitlines()[2:]] == WORKLOADS
    assert (tmp_path / "pipeline.png").read_bytes().startswith(b"\x89PNG")


def test_relative_rate_compares_within_a_round() -> None:
    """A machine that becomes ten times as slow after the first round changes no ratio."""
    assert relative_rate(single_runs([1.0, 10.0, 10.0]), single_runs([2.0, 20.0, 20.0])) == 2.0


@pytest.fixture
def stages(demonstration_folder: Path, spec: SkillSpec) -> Stages:
    return Stages.of(ImageFolder(demonstration_folder), 4, spec, "cpu", 3)


@pytest.mark.slow
def test_workloads_process_all_frames_with_the_same_skill(
    stages: Stages, demonstration_frames: tuple[np.ndarray, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    workloads = stages.workloads()
    extracted: list[bytes] = []
    observed: list[bytes] = []
    extract, observe = Skill.extract, Skill.observe

    def recorded(calls: list[bytes], method: Callable[..., Any]) -> Callable[..., Any]:
        def call(skill: Skill, frame: np.ndarray, *features: Any) -> Any:
            calls.append(frame.tobytes())
            return method(skill, frame, *features)

        return call

    monkeypatch.setattr(Skill, "extract", recorded(extracted, extract))
    monkeypatch.setattr(Skill, "observe", recorded(observed, observe))
    frames = [frame.tobytes() for frame in demonstration_frames[:4]]
    for name, workload in workloads.items():
        extracted.clear()
        observed.clear()
        workload()
        # Threads start with any of the frames that are ready.
        assert sorted(extracted) == (sorted(frames) if name.startswith((EXTRACT, "all")) else [])
        assert observed == (frames if name.startswith(("select", "all")) else [])
    assert list(workloads)[-1] == OVERLAPPED


def test_prototypes_are_descriptors_of_the_video(stages: Stages) -> None:
    descriptors = {row.tobytes() for feature_sets in stages.features for row in feature_sets["sift"].descriptors}
    for member in stages.skill.members.values():
        prototypes = member.scorer.prototype_score.get_buffer("point_prototypes")
        assert {row.numpy().tobytes() for row in prototypes} <= descriptors
        assert not torch.equal(prototypes[0], prototypes[1])
    assert all(frame is not following for frame, following in pairwise(stages.frames))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["frames=0"], "frames=0: expected a whole number of at least 1"),
        (["repeats=0"], "repeats=0: expected a whole number of at least 1"),
        (["threads=0"], "threads=0: expected a whole number of at least 1, or null"),
        (["threads=x"], "threads=x: expected a whole number"),
        (["device=tpu"], "device=tpu: expected cpu or cuda"),
        (["top_k=0"], "top_k=0: expected a whole number of at least 1"),
        (["model.hidden_dim=0"], "model.hidden_dim=0: expected a whole number of at least 1"),
        (["features.max_features=1"], "features.max_features=1: expected a whole number of at least 2"),
        (["descriptor=lbd"], "kernel=p2p joins a point"),
        (["video=/no/such.mp4"], "'/no/such.mp4' does not exist"),
        (["video=98"], "camera 98: cannot be opened"),
        (["task=video"], "task=video is no simulated task; expected one such as task=sorting, or video="),
        (["scenario.severity=9"], "scenario.severity=9"),
        (["kernel=p2q"], "In 'pipeline': Could not find 'kernel/p2q'"),
        (["frame=8"], "'frame': there is no such key; expected frames"),
    ],
)
def test_pipeline_rejects_bad_input(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from hydra.core.global_hydra import GlobalHydra

    from geoskill.benchmarks.config import PipelineConfig
    from geoskill.benchmarks.pipeline import measure
    from geoskill.cli.command import run_command

    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setenv("OMP_WAIT_POLICY", "PASSIVE")
    monkeypatch.setattr(sys, "argv", ["pipeline", *arguments, f"hydra.run.dir={tmp_path}"])
    GlobalHydra.instance().clear()
    with pytest.raises(SystemExit) as exit_info:
        run_command("pipeline", PipelineConfig, measure)
    message_printed = capsys.readouterr().err
    assert exit_info.value.code == 2
    assert message_printed.startswith(f"error: {message}")
    assert message_printed.count("\n") == 1
    assert not (tmp_path / "pipeline.json").exists()


def test_stages_reject_video_without_features(tmp_path: Path, spec: SkillSpec) -> None:
    import cv2

    from geoskill.errors import InputError

    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((60, 80, 3), np.uint8))
    with pytest.raises(InputError, match=r"no point in 1 frames; expected some for p2p_sift"):
        Stages.of(ImageFolder(tmp_path), 4, spec, "cpu", 2)
