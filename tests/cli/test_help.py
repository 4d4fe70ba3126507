"""``--help``: what a command does, its examples, its own groups and every key."""

import re
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from geoskill.cli.compose import compose_training, configuration_folder
from geoskill.cli.help import EXAMPLES, help_text
from geoskill.cli.schemas import COMMANDS
from geoskill.schema import flatten

CONFIGURATION = Path(configuration_folder())


def text_of(command: str) -> str:
    return help_text(command, COMMANDS[command], ["/usr/bin/python3", f"{command}.py"], CONFIGURATION)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_key_has_a_line(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    text = text_of(command)
    assert re.match(rf"python3? {command}\.py \[KEY=VALUE \.\.\.\]\n  \w", text)
    assert len(EXAMPLES[command]) == 3
    assert max(map(len, text.splitlines())) <= 120
    groups = {"kernel", "descriptor", "model", "task", "logger", "artifact", "controller", "plant"}
    for key, _, _ in flatten(COMMANDS[command]):
        if key not in groups:
            assert re.search(rf"^  {re.escape(key)}=\S*\s+\S", text, re.MULTILINE), key


def test_only_the_groups_of_the_command() -> None:
    chosen = {command: re.findall(r"^  (\w+)= +[a-z]", text_of(command), re.MULTILINE) for command in COMMANDS}
    groups = ["kernel", "descriptor", "model", "task", "scenario", "trainer", "experiment", "logger"]
    assert chosen["train"] == groups
    assert chosen["infer"] == []
    assert chosen["evaluate"] == ["task", "scenario"]
    assert chosen["reproduce"] == ["artifact"]
    assert chosen["serve"] == []
    assert chosen["servo"] == ["task", "scenario", "controller", "plant"]
    assert "  plant.pairs=8 " in text_of("servo")
    assert "task=video" not in text_of("evaluate")


def test_examples_are_valid() -> None:
    for examples in EXAMPLES.values():
        for given, _ in examples:
            OverridesParser.create().parse_overrides(given.split())
    for given, _ in EXAMPLES["train"]:
        compose_training(*given.split())
