"""Killed at a named point and resumed in the same folder, a training ends with the results of an unbroken one."""

import json
import signal
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.io.lock import LOCK
from geoskill.skill.skill import Skill
from tests.cli.test_command import KILLED

Command = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[2]
CALLBACKS = "geoskill.training.callbacks"
REPORTING = "geoskill.cli.reporting"
# MODULE:OWNER:FUNCTION:CALL:when of a training of two epochs of three steps.
POINTS = [
    *(
        f"{CALLBACKS}:MetricsTable:on_train_batch_end:{step}:{when}"
        for step in (1, 3, 4, 6)
        for when in ("before", "after")
    ),
    *(f"{CALLBACKS}:ResumableCheckpoint:_save:{number}:{when}" for number in (1, 2, 3) for when in ("before", "after")),
    *(f"lightning:Trainer:save_checkpoint:{number}:after" for number in (1, 2, 3)),
    f"{CALLBACKS}:SkillRecord:on_train_end:1:before",
    f"{CALLBACKS}:SkillRecord:on_train_end:1:after",
    *(f"{CALLBACKS}:MetricsTable:write:{number}:after" for number in (1, 2)),
    *(f"geoskill.viz.video_writer:VideoWriter:write:{number}:after" for number in (1, 20)),
    *(f"{REPORTING}:_Results:add:{number}:after" for number in (1, 20)),
    *(f"{REPORTING}:_Results:write:1:{when}" for when in ("before", "after")),
    "geoskill.viz.video_writer:VideoWriter:__exit__:1:before",
    "geoskill.viz.video_writer:VideoWriter:__exit__:1:after",
    *(f"json:JSONEncoder:iterencode:1:{when}" for when in ("before", "after")),
]


def weights_of(folder: Path) -> dict[str, torch.Tensor]:
    weights: dict[str, torch.Tensor] = torch.load(folder / "skill.ckpt", weights_only=True)["state_dict"]
    return weights


@pytest.mark.parametrize("point", POINTS)
def test_killed_and_resumed_training_has_the_results_of_an_unbroken_one(
    python: Command,
    command: Command,
    tiny: Sequence[str],
    trained: Any,
    rounds: int,
    tmp_path: Path,
    point: str,
) -> None:
    if rounds < 1000 and POINTS.index(point) % 6:
        pytest.skip("one in six of these points; all of them by make robustness")
    run = tmp_path / "run"
    overrides = [*tiny, f"hydra.run.dir={run}"]
    killed = python("-c", KILLED, point, *overrides)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    resume = [f"ckpt_path={run / 'skill.ckpt'}"] if (run / "skill.ckpt").exists() else []
    resumed = command("train", *overrides, *resume)
    assert (resumed.status, resumed.stderr) == (0, "")
    for name in ("associations.jsonl", "skill.yaml", "metrics.csv"):
        assert (run / name).read_bytes() == (trained.folder / name).read_bytes(), name
    assert json.loads((run / "metrics.json").read_text()) == json.loads((trained.folder / "metrics.json").read_text())
    ours, theirs = weights_of(run), weights_of(trained.folder)
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # an unfinished skill would warn
        Skill.load(run)
    left = {path.name for path in run.iterdir() if path.name.startswith(".")}
    assert left == {".hydra"}, f"left over, or {LOCK} is still there"
