"""``python reproduce.py``: its refusals, and a whole small one that goes on where it was stopped."""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from geoskill.cli.command import configuration_folder
from geoskill.cli.settings import check_kind

Command = Callable[..., Any]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "error: artifact.data is not set; expected the folder of the labeled sequences (artifact.data=DIR)"),
        (["artifact.data=nowhere"], "error: artifact.data=nowhere: has no folder human1; expected one with frames"),
        (["artifact=table9"], "error: In 'reproduce': Could not find 'artifact/table9'"),
    ],
)
def test_bad_input(command: Command, tmp_path: Path, arguments: Sequence[str], message: str) -> None:
    ended = command("reproduce", *arguments, f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith(message)


def test_jobs_must_be_positive(command: Command, tmp_path: Path, demonstration_folder: Path) -> None:
    for name in ("human1", "robot1"):
        (tmp_path / name).mkdir()
    ended = command("reproduce", f"artifact.data={tmp_path}", "jobs=0", f"hydra.run.dir={tmp_path / 'run'}")
    assert (ended.status, ended.stderr) == (2, "error: jobs=0: expected at least 1\n")


def rows() -> list[str]:
    folder = Path(configuration_folder()) / "artifact"
    found = [row for path in sorted(folder.glob("*.yaml")) for row in OmegaConf.load(path).rows.values()]
    return sorted({override for row in found for override in row})


@pytest.mark.parametrize("override", rows())
def test_what_rows_change_is_what_training_takes(override: str) -> None:
    key, _, _ = override.partition("=")
    with initialize_config_dir(configuration_folder(), version_base="1.3"):
        default, changed = compose("train"), compose("train", [override])
    if "." in key:  # one value; a group has been composed, which refuses what there is not
        check_kind(key, OmegaConf.select(changed, key), OmegaConf.select(default, key))
        assert OmegaConf.select(changed, key) != OmegaConf.select(default, key)


@pytest.mark.slow
def test_train_score_and_go_on(
    command: Command, tiny: Sequence[str], demonstration_folder: Path, tmp_path: Path
) -> None:
    data, run = tmp_path / "data", tmp_path / "run"
    square = [[100, 40], [150, 40], [150, 90], [100, 90]]
    labels = {"object": [[20, 40], [60, 40], [60, 90], [20, 90]], "target": square, "hand": []}
    for name in ("human1", "robot1"):
        shutil.copytree(demonstration_folder, data / name)
        regions = {"image_size": [160, 120], "frames": {"0": labels, "19": labels}}
        (data / f"{name}.regions.json").write_text(json.dumps(regions))
    overrides = [override for override in tiny if not override.startswith(("task", "logger", "threads"))]
    artifact = {
        "name": "tiny",
        "data": str(data),
        "train": ["task=video", "task.path=${artifact.data}/human1"],
        "tests": {
            name: [f"video=${{artifact.data}}/{name}", f"regions=${{artifact.data}}/{name}.regions.json"]
            for name in ("human1", "robot1")
        },
        "every": 5,
        "seeds": [3],
        "rows": {"default": overrides},
        "published": {"default": {"human1": 50.0}},
        "baseline": False,
    }
    (tmp_path / "conf" / "artifact").mkdir(parents=True)
    (tmp_path / "conf" / "artifact" / "tiny.yaml").write_text(json.dumps(artifact))
    arguments = ["--config-dir", str(tmp_path / "conf"), "artifact=tiny", "jobs=1", f"hydra.run.dir={run}"]
    ended = command("reproduce", *arguments)
    assert ended.status == 0, ended.stderr
    assert ended.folder == run / "full"
    scores = json.loads((run / "full" / "default" / "3" / "scores.json").read_text())
    assert scores["seed"] == 3
    assert scores["robot1"]["frames"] == 4
    assert "| default | 1 |" in (run / "full" / "table.md").read_text()
    assert "(published 50.0)" in (run / "full" / "table.md").read_text()
    for name in ("table.csv", "table.json", "accuracy.png", "reliability.png", "training.png"):
        assert (run / "full" / name).stat().st_size > 0

    checkpoint = run / "full" / "default" / "3" / "skill.ckpt"
    before = checkpoint.stat().st_mtime_ns
    assert command("reproduce", *arguments).status == 0
    assert checkpoint.stat().st_mtime_ns == before, "what is done is not done again"
