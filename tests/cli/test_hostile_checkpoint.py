"""A checkpoint from somebody else: nothing in it is called, imported or opened, and wrong types are refused."""

import copy
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.plugins import REGISTRIES
from geoskill.schema import as_plain
from geoskill.skill.skill import Skill

Command = Callable[..., Any]

# What Python reports when something is executed, imported, opened or connected to.
FORBIDDEN = ("os.", "subprocess.", "shutil.", "socket.", "ctypes.", "import", "open")
WRONG_TYPES = (None, True, -1, 1.5, float("nan"), "x", b"x", [], [[]], {}, {"a": {}}, {1: 2}, torch.zeros(1))
events: list[tuple[str, Any]] | None = None  # recorded while it is a list


def record_event(name: str, arguments: tuple[Any, ...]) -> None:
    if events is not None and name.startswith(FORBIDDEN):
        events.append((name, arguments[:1]))


sys.addaudithook(record_event)


def attacks(flag: Path) -> list[Any]:
    """What Hydra would call, and names that would leave the flag behind if they were imported or called."""
    (flag.parent / "hostile_module.py").write_text(f"open({str(flag)!r}, 'w').close()")
    return [
        {"_target_": "os.system", "_args_": [f"touch {flag}"]},
        {"_target_": "os.system", "command": f"touch {flag}"},
        {"_target_": "pathlib.Path.touch", "_args_": [{"_target_": "pathlib.Path", "_args_": [str(flag)]}]},
        {"name": "hostile_module", "package": "hostile_module", "arguments": {}},
        "hostile_module",
        f"${{oc.env:HOME}}/{flag.name}",
    ]


def places(node: Any, where: str = "") -> Iterator[tuple[Any, Any, str]]:
    """Every container of a checkpoint's plain values with every key in it, and their dotted name."""
    keys = list(node) if isinstance(node, dict) else range(len(node))
    for key in keys:
        yield node, key, f"{where}.{key}"
        if isinstance(node[key], dict | list):
            yield from places(node[key], f"{where}.{key}")


@pytest.fixture
def simulated_skill(skill: Path, tmp_path: Path) -> Path:
    """A skill that says it learned in simulation."""
    checkpoint = torch.load(skill, weights_only=True)
    scene = {"task": "sorting", "seed": 0, "scenario": as_plain(ScenarioConfig())}
    checkpoint["skill"]["provenance"]["scene"] = scene
    small = {key: checkpoint[key] for key in ("skill", "state_dict")}
    torch.save(small, tmp_path / "simulated.ckpt")
    return tmp_path / "simulated.ckpt"


def load(path: Path) -> list[tuple[str, Any]]:
    """Load a skill, or refuse it, and return what was executed, imported or opened besides."""
    global events
    events, message = [], f"{path}: expected"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            repr(Skill.load(path))
    except InputError as error:
        message = str(error)
    finally:
        recorded, events = events, None
    assert message.startswith(f"{path}: ")
    assert any(words in message for words in ("expected", "do not fit", "which is not installed here")), message
    return [event for event in recorded if event != ("open", (str(path),))]


@pytest.fixture
def check_everywhere(simulated_skill: Path, tmp_path: Path) -> Callable[[list[Any]], None]:
    """``check_everywhere(values)`` puts each value at every place of a checkpoint and loads it."""
    original = torch.load(simulated_skill, weights_only=True)
    path = tmp_path / "hostile.ckpt"

    def check(values: list[Any]) -> None:
        for registry in REGISTRIES:
            registry.names()  # reads which plug-ins are installed
        repr(WRONG_TYPES)  # messages show them
        for warm_up in (b"x", {}, original["skill"]):  # imports what loading and refusing need anyway
            torch.save({**original, "skill": copy.deepcopy(warm_up)}, path)
            load(path)
        count = sum(1 for _ in places({"skill": original["skill"]}))
        assert count > 100
        for number in range(count):
            for value in values:
                entry = {"skill": copy.deepcopy(original["skill"])}
                container, key, where = list(places(entry))[number]
                container[key] = value
                torch.save({**original, **entry}, path)
                assert load(path) == [], (where, value)

    return check


@pytest.mark.usefixtures("annotations_unchecked")
@pytest.mark.parametrize("number", [0, *(pytest.param(other, marks=pytest.mark.slow) for other in range(1, 6))])
def test_attacks_run_nothing(
    check_everywhere: Callable[[list[Any]], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    flag = tmp_path / "flag"
    attack = attacks(flag)[number]
    monkeypatch.syspath_prepend(tmp_path)
    check_everywhere([attack])
    assert not flag.exists()
    assert "hostile_module" not in sys.modules


@pytest.mark.slow
@pytest.mark.usefixtures("annotations_unchecked")
@pytest.mark.parametrize("number", range(len(WRONG_TYPES)))
def test_wrong_types_are_refused_or_harmless(check_everywhere: Callable[[list[Any]], None], number: int) -> None:
    check_everywhere([WRONG_TYPES[number]])


@pytest.mark.usefixtures("annotations_unchecked")
def test_added_keys_are_refused(simulated_skill: Path, tmp_path: Path) -> None:
    original = torch.load(simulated_skill, weights_only=True)
    free = ("configuration", "metrics", "arguments")  # whose keys are not fixed, or refused later
    for number, (container, key, where) in enumerate(places(original["skill"])):
        if isinstance(container[key], dict) and not any(part in where for part in free):
            checkpoint = copy.deepcopy(original)
            changed, own_key, _ = list(places(checkpoint["skill"]))[number]
            changed[own_key]["_target_"] = "os.getcwd"
            torch.save(checkpoint, tmp_path / "hostile.ckpt")
            with pytest.raises(InputError, match="_target_"):
                Skill.load(tmp_path / "hostile.ckpt")


@pytest.mark.parametrize("number", range(3))
def test_evaluating_a_hostile_scene_runs_nothing(
    command: Command, simulated_skill: Path, tmp_path: Path, number: int
) -> None:
    flag = tmp_path / "flag"
    checkpoint = torch.load(simulated_skill, weights_only=True)
    checkpoint["skill"]["provenance"]["scene"]["scenario"] |= attacks(flag)[number]
    torch.save(checkpoint, simulated_skill)
    ended = command(
        "evaluate", f"skill={simulated_skill}", "task=sorting", "every=200", f"hydra.run.dir={tmp_path / 'run'}"
    )
    assert not flag.exists()
    assert ended.status == 2
    assert len(ended.stderr.splitlines()) == 1
    assert "provenance.scene.scenario has " in ended.stderr
    assert "_target_" in ended.stderr
