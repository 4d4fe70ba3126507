"""YAML that a person has written: plain values, each with the line that it stands on."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, final

import yaml

from geoskill.errors import InputError, shown

MAX_BYTES: Final = 1_000_000
MAX_DEPTH: Final = 16
_PLAIN: Final = tuple(f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str"))


@final
@dataclass(frozen=True)
class Marked:
    """A value of a file.

    Attributes:
        value: plain, or a list or mapping of further ones.
        line: on which it begins, from 1.
    """

    value: "bool | int | float | str | list[Marked] | dict[str, Marked] | None"
    line: int

    def plain(self) -> Any:
        """Return the value without marks."""
        if isinstance(self.value, dict):
            return {key: own.plain() for key, own in self.value.items()}
        return [own.plain() for own in self.value] if isinstance(self.value, list) else self.value


def read_marked_yaml(path: Path) -> Marked:
    """Read a file of one YAML document.

    There are no tags, anchors and aliases in it, so that it makes no objects and takes no more memory than its size
    times a constant.

    Raises:
        InputError: when the file cannot be read, is too large or is no such document; the message names the line.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: has {path.stat().st_size} bytes; expected a file of at most {MAX_BYTES}")
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
        raise InputError(f"{path}: cannot be read ({reason}); expected a YAML file") from error
    try:
        events = iter(list(yaml.parse(text, Loader=yaml.SafeLoader)))
        return _document(path, events)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        place = f"{path}:" if mark is None else f"{path} line {mark.line + 1}:"
        reason = getattr(error, "problem", None) or " ".join(str(error).split())[:200]
        raise InputError(f"{place} is no YAML ({reason})") from error


def _document(path: Path, events: Iterator[yaml.Event]) -> Marked:
    documents: list[Marked] = []
    for event in events:
        if isinstance(event, yaml.DocumentStartEvent):
            if documents:
                raise InputError(f"{path} line {_line(event)}: begins another document; expected one")
            documents.append(_value(path, next(events), events, MAX_DEPTH))
    if not documents:
        raise InputError(f"{path}: is empty; expected a YAML document")
    return documents[0]


def _value(path: Path, event: yaml.Event, events: Iterator[yaml.Event], depth: int) -> Marked:
    """Return the value that begins with an event, and take its other events."""
    line = _line(event)
    where = f"{path} line {line}"
    if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None) is not None:
        raise InputError(f"{where}: has an anchor or alias; expected plain values")
    if isinstance(event, yaml.ScalarEvent):
        return Marked(_scalar(where, event), line)
    if getattr(event, "tag", None) is not None:
        raise InputError(f"{where}: has the tag {shown(event.tag)}; expected plain values")  # type: ignore[attr-defined]
    if depth == 0:
        raise InputError(f"{where}: is nested deeper than {MAX_DEPTH}; expected a task definition")
    if isinstance(event, yaml.SequenceStartEvent):
        entries = []
        while not isinstance(following := next(events), yaml.SequenceEndEvent):
            entries.append(_value(path, following, events, depth - 1))
        return Marked(entries, line)
    named: dict[str, Marked] = {}
    while not isinstance(following := next(events), yaml.MappingEndEvent):
        key = _value(path, following, events, depth - 1)
        if not isinstance(key.value, str):
            raise InputError(f"{path} line {key.line}: a key is {shown(key.plain())}; expected text")
        if key.value in named:
            raise InputError(f"{path} line {key.line}: {shown(key.value)} occurs twice; expected once")
        own = _value(path, next(events), events, depth - 1)
        # An entry stands where its key does.
        named[key.value] = Marked(own.value, key.line)
    return Marked(named, line)


def _line(event: yaml.Event) -> int:
    return 0 if event.start_mark is None else event.start_mark.line + 1


def _scalar(where: str, event: yaml.ScalarEvent) -> bool | int | float | str | None:
    loader = yaml.SafeLoader("")
    tag = event.tag or loader.resolve(yaml.ScalarNode, event.value, event.implicit)  # type: ignore[no-untyped-call]
    if event.tag is not None or tag not in _PLAIN:
        raise InputError(f"{where}: {shown(event.value)} is a {tag.rpartition(':')[2]}; expected plain values")
    try:
        value = loader.construct_object(yaml.ScalarNode(tag, event.value))
    except (ValueError, yaml.YAMLError) as error:
        raise InputError(f"{where}: {shown(event.value)} cannot be read; expected a plain value") from error
    if isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{where}: {event.value} is no finite number; expected one")
    return value  # type: ignore[no-any-return]
