"""A checkpoint from somebody else: nothing in it is ever called, imported or opened."""

import contextlib
import copy
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

Command = Callable[..., Any]


def attacks(flag: Path) -> list[dict[str, Any]]:
    """What Hydra would call, and what would leave the flag behind."""
    return [
        {"_target_": "os.system", "_args_": [f"touch {flag}"]},
        {"_target_": "os.system", "command": f"touch {flag}"},
        {"_target_": "pathlib.Path.touch", "_args_": [{"_target_": "pathlib.Path", "_args_": [str(flag)]}]},
    ]


def places(node: Any) -> Iterator[tuple[Any, Any]]:
    """Every container of a checkpoint's plain values with every key in it."""
    keys = list(node) if isinstance(node, dict) else range(len(node))
    for key in keys:
        yield node, key
        if isinstance(node[key], dict | list):
            yield from places(node[key])


@pytest.fixture
def simulated_skill(skill: Path, tmp_path: Path) -> Path:
    """A skill that says it learned in simulation."""
    checkpoint = torch.load(skill, weights_only=True)
    checkpoint["skill"]["learned_from"] = {"task": "sorting", "seed": 0, "scenario": {"actor": "human"}}
    torch.save(checkpoint, tmp_path / "simulated.ckpt")
    return tmp_path / "simulated.ckpt"


def number_of_places(path: Path) -> int:
    return sum(1 for _ in places(torch.load(path, weights_only=True)["skill"]))


def test_nothing_of_a_checkpoint_is_instantiated(
    simulated_skill: Path, tmp_path: Path, annotations_unchecked: None
) -> None:
    from geoskill.cli.footage import stored_conditions
    from geoskill.errors import InputError
    from geoskill.skill.skill import Skill

    flag = tmp_path / "flag"
    original = torch.load(simulated_skill, weights_only=True)
    path = tmp_path / "hostile.ckpt"
    for place in range(number_of_places(simulated_skill)):
        checkpoint = copy.deepcopy(original)
        container, key = list(places(checkpoint["skill"]))[place]
        container[key] = attacks(flag)[place % 3]
        torch.save(checkpoint, path)
        with contextlib.suppress(InputError, KeyError, TypeError):
            stored_conditions(Skill.load(path).learned_from["scenario"])
        assert not flag.exists(), key


@pytest.mark.parametrize("number", range(3))
def test_evaluating_a_hostile_scenario_runs_nothing(
    command: Command, simulated_skill: Path, tmp_path: Path, number: int
) -> None:
    flag = tmp_path / "flag"
    checkpoint = torch.load(simulated_skill, weights_only=True)
    attack = attacks(flag)[number]
    checkpoint["skill"]["learned_from"]["scenario"] |= attack
    torch.save(checkpoint, simulated_skill)
    ended = command(
        "evaluate", f"skill={simulated_skill}", "task=sorting", "every=200", f"hydra.run.dir={tmp_path / 'run'}"
    )
    assert not flag.exists()
    assert ended.status == 2
    assert "learned_from.scenario has '_target_'" in ended.stderr
