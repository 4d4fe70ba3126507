"""Paths with whatever characters, from the command line to the configuration, and back through a shell."""

import os
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from geoskill.cli.compose import compose_training
from geoskill.cli.paths import PATH_KEYS, with_literal_paths
from geoskill.cli.schemas import COMMANDS, VideoTaskConfig
from geoskill.plugins import EXTRACTORS
from geoskill.schema import flatten

NASTY = (
    "müller.mp4",
    "видео.mp4",
    "動画.mp4",
    "IMG_0001 (1).mp4",
    "Bob's video.mp4",
    'the "best".mp4',
    "lr=0.1/v.mp4",
    "a,b.mp4",
    "x&y [final].mp4",
    "[a.mp4,b.mp4]",
    "{a: b}",
    "2024_01_05",
    "1e5",
    "007",
    "nan",
    "true",
    "100% done; rm -rf #1!.mp4",
    "back\\slash\\",
    "${oc.env:HOME}.mp4",
    "\\${x}\\",
    "two\nlines",
    " spaces ",
    "-1",
    "a:b@c|d",
    "'quoted'",
    '"quoted"',
    "glob(*)",
    "~",
)
names = st.text(st.characters(exclude_characters="/\0", exclude_categories=["Cs"]), min_size=1, max_size=12).filter(
    lambda name: name not in (".", "..", "???", "null") and len(name.encode()) < 200
)


def value_of(argument: str) -> object:
    """Return the value that a command gets."""
    override = OverridesParser.create().parse_override(argument)
    assert not override.is_sweep_override()
    return OmegaConf.to_container(OmegaConf.create({"value": override.value()}), resolve=True)["value"]  # type: ignore[call-overload, index]


@pytest.fixture(scope="module", autouse=True)
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A working folder, where names need no path."""
    folder, before = tmp_path_factory.mktemp("paths"), Path.cwd()
    os.chdir(folder)
    yield folder
    os.chdir(before)


def make(name: str) -> None:
    path = Path(f"./{name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()


def check_existing_path(key: str, name: str) -> None:
    (argument,) = with_literal_paths([f"{key}={name}"])
    assert value_of(argument) == name
    # What is printed to go on is pasted into a shell, and comes back by the door.
    (pasted,) = shlex.split(shlex.join([argument]))
    assert with_literal_paths([pasted]) == [argument]


@pytest.mark.parametrize("name", NASTY)
def test_path_that_exists_is_itself(name: str) -> None:
    make(name)
    for key in (*PATH_KEYS, "+video", "++task.path"):
        check_existing_path(key, name)
    (swept,) = with_literal_paths([f"video={name}"], multirun=True)
    assert value_of(swept) == name


@given(names)
def test_any_path_that_exists_is_itself(name: str) -> None:
    make(name)
    check_existing_path("task.path", name)


@given(names.filter(lambda name: "${" not in name and not name.startswith("~") and name[0] not in "'\"["))
def test_any_path_that_does_not_exist_is_in_the_message(name: str) -> None:
    (argument,) = with_literal_paths([f"video=absent/{name}"])
    assert value_of(argument) == f"absent/{name}"
    assert with_literal_paths([argument]) == [argument]


@given(st.lists(names.filter(lambda name: name.strip() == name), min_size=1, max_size=4, unique=True))
def test_lists_of_paths_that_exist(files: list[str]) -> None:
    for name in files:
        make(name)
    written = [f"./{name}" for name in files]
    if all("," not in name for name in files):
        (argument,) = with_literal_paths([f"task.path=[{','.join(written)}]"])
        assert value_of(argument) == written


def test_comma_in_the_name_of_a_listed_file() -> None:
    make("first,take.mp4")
    make("Bob's.mp4")
    (argument,) = with_literal_paths(["task.path=[first,take.mp4, Bob's.mp4,other.mp4]"])
    assert value_of(argument) == ["first,take.mp4", "Bob's.mp4", "other.mp4"]


@pytest.mark.parametrize(
    ("argument", "expected"),
    [
        ("video='a b.mp4'", "a b.mp4"),  # as Hydra wants it
        ('video="a\\"b.mp4"', 'a"b.mp4'),
        ("skill=null", None),
        ("task.path=[]", []),
        ("task.path=[2024,'1,5',b c]", ["2024", "1,5", "b c"]),
        ("video=0", "0"),
    ],
)
def test_values_of_hydra_keep_their_meaning(argument: str, expected: object) -> None:
    (literal,) = with_literal_paths([argument])
    assert value_of(literal) == expected
    assert with_literal_paths([literal]) == [literal]


def test_interpolations_keep_their_meaning() -> None:
    arguments = ["task.path=${oc.env:HOME}/v.mp4", "hydra.run.dir=my runs (1)/${now:%Y-%m-%d}"]
    first, second = with_literal_paths(arguments)
    assert first == arguments[0]
    assert second == 'hydra.run.dir="my runs (1)/${now:%Y-%m-%d}"'


def test_home_is_expanded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/Bob's")
    arguments = with_literal_paths(["video=~/v.mp4", "task.path=[~/a.mp4,b.mp4]", "skill=~no-such-user/run"])
    values = [value_of(argument) for argument in arguments]
    assert values == ["/home/Bob's/v.mp4", ["/home/Bob's/a.mp4", "b.mp4"], "~no-such-user/run"]


def test_values_of_a_sweep() -> None:
    arguments = [
        "task.path=a (1).mp4,1e5",
        "video=[a b.mp4,c],[d]",
        "regions=glob(r*)",
        "skill=choice(a,b)",
        "seed=1,2",
    ]
    assert with_literal_paths(arguments, multirun=True) == [
        'task.path="a (1).mp4","1e5"',
        "video=[a b.mp4,c],[d]",
        "regions.path=glob(r*)",
        "skill=choice(a,b)",
        "seed=1,2",
    ]


@pytest.mark.parametrize("argument", ["--multirun", "seed=1e5", "kernel=p2p", "~task.path", "task=video", "video"])
def test_other_arguments_stay(argument: str) -> None:
    assert with_literal_paths([argument]) == [argument]


def test_every_key_that_takes_a_path_is_known() -> None:
    words = ("file", "folder", "checkpoint", "skill.ckpt", "skill whose")
    schemas = [("", schema) for schema in COMMANDS.values()] + [("task.", VideoTaskConfig)]
    told = {
        key
        for prefix, schema in schemas
        for key, own, hint in flatten(schema, prefix)
        if hint in (Any, str | None) and any(word in own.metadata.get("help", "").lower() for word in words)
    }
    hydras = {key for key in PATH_KEYS if key.startswith("hydra.")}
    weights = {key for key in PATH_KEYS if key.startswith("descriptor.")}
    learned = {name for name in EXTRACTORS.built_in if "weights" in EXTRACTORS.parameters(name)}
    assert weights == {f"descriptor.{name}.weights" for name in learned}
    assert told - {"artifact", "export"} == set(PATH_KEYS) - hydras - weights - {"artifact.data"}


def test_overrides_from_python() -> None:
    assert compose_training("task=video", "task.path=Bob's (1).mp4").task.path == "Bob's (1).mp4"
