"""Configuration dataclasses that document and check themselves.

A field made by :func:`setting` carries its default, its meaning and its range. The same declaration checks values that
come from Python and from the command line, and makes the reference in the documentation.
"""

import functools
import math
import types
from abc import ABC
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, field, fields, is_dataclass
from typing import Any, Union, get_args, get_origin, get_type_hints

from geoskill.errors import InputError

WORDS = {int: "a whole number", float: "a number", bool: "true or false", str: "text"}


class Config(ABC):  # noqa: B024  # what subclasses share is the check of their fields
    """A dataclass whose fields are checked when it is made.

    Raises:
        InputError: for a value of a wrong type or out of range.
    """

    def __post_init__(self) -> None:
        check_fields(self)


def setting(
    default: Any,
    help: str,
    *,
    at_least: float | None = None,
    at_most: float | None = None,
    above: float | None = None,
    below: float | None = None,
    choices: Sequence[str] | None = None,
) -> Any:
    """Return a dataclass field with its documentation and its range.

    Args:
        default: the value, or a class or function that makes it.
        help: what the setting does, for the reference.
        at_least: smallest value.
        at_most: largest value.
        above: value that must be exceeded.
        below: value that must not be reached.
        choices: the words that are allowed.
    """
    limits = {"at_least": at_least, "at_most": at_most, "above": above, "below": below, "choices": choices}
    metadata = {"help": help, **{name: limit for name, limit in limits.items() if limit is not None}}
    if callable(default):
        return field(default_factory=default, metadata=metadata)
    return field(default=default, metadata=metadata)


def check_fields(config: Any) -> None:
    """Check the fields of one dataclass; for its ``__post_init__``.

    Raises:
        InputError: for the first value of a wrong type or out of range, as ``NAME=VALUE: expected …``.
    """
    for name, settings_field, hint in settings_of(type(config)):
        check_value(name, getattr(config, name), settings_field, hint)


def settings_of(schema: type) -> Iterator[tuple[str, "Field[Any]", Any]]:
    """Yield name, field and type of every setting of a configuration class."""
    hints = get_type_hints(schema)
    for each_field in fields(schema):
        yield each_field.name, each_field, hints[each_field.name]


def check_value(name: str, value: Any, settings_field: "Field[Any]", hint: Any) -> None:
    """Check one value.

    Raises:
        InputError: when it has a wrong type or is out of range.
    """
    kinds = _kinds(hint)
    if _is_schema(hint):
        if isinstance(value, hint):
            return
    elif not kinds or (value is None and type(None) in kinds):
        return
    if not (_has_kind(value, kinds) and _in_range(value, settings_field.metadata)):
        raise InputError(f"{name}={as_written(value)}: expected {expectation(settings_field, hint)}")


def as_written(value: Any) -> str:
    """Return a value as it is written on the command line.

    >>> [as_written(value) for value in (None, True, 1, 0.5, "sift")]
    ['null', 'true', '1', '0.5', 'sift']
    """
    if value is None:
        return "null"
    return str(value).lower() if isinstance(value, bool) else str(value)


def expectation(settings_field: "Field[Any]", hint: Any) -> str:
    """Describe the values that a setting takes.

    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Example:
    ...     share: float | None = setting(0.5, "A share.", at_least=0, below=1)
    >>> [expectation(own, hint) for _, own, hint in settings_of(Example)]
    ['a number of at least 0 and below 1, or null']
    """
    kinds, limits = _kinds(hint), settings_field.metadata
    if _is_schema(hint):
        return str(hint.__name__)
    if "choices" in limits:
        words = [str(choice) for choice in limits["choices"]]
        text = " or ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
    else:
        text = " or ".join(WORDS[kind] for kind in (bool, int, float, str) if kind in kinds) or "a value"
        names = {"above": "above", "at_least": "at least", "below": "below", "at_most": "at most"}
        bounds = " and ".join(f"{word} {limits[name]:g}" for name, word in names.items() if name in limits)
        text = f"{text} {'of ' if bounds.startswith('at') else ''}{bounds}".rstrip()
    return f"{text}, or null" if type(None) in kinds else text


def default_of(settings_field: "Field[Any]") -> Any:
    """Return the default value of a setting."""
    if settings_field.default is not MISSING:
        return settings_field.default
    assert settings_field.default_factory is not MISSING
    return settings_field.default_factory()


def flatten(schema: type, prefix: str = "") -> Iterator[tuple[str, "Field[Any]", Any]]:
    """Yield dotted key, field and type of every setting of a configuration class and of those nested in it."""
    for name, settings_field, hint in settings_of(schema):
        key = f"{prefix}{name}"
        if _is_schema(hint):
            yield from flatten(hint, f"{key}.")
        else:
            yield key, settings_field, hint


def as_plain(value: Any) -> Any:
    """Return a configuration, or a part of one, as nested dictionaries, lists and plain values."""
    if is_dataclass(value) and not isinstance(value, type):
        return {own.name: as_plain(getattr(value, own.name)) for own in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): as_plain(entry) for key, entry in value.items()}
    return [as_plain(entry) for entry in value] if isinstance(value, list | tuple) else value


def markdown_table(schema: type, prefix: str = "") -> str:
    """Return the reference of a configuration class as a Markdown table."""
    defaults = schema()  # whose nested configurations may differ from the defaults of their classes
    rows = []
    for key, settings_field, hint in flatten(schema):
        default = functools.reduce(getattr, key.split("."), defaults)
        expected = expectation(settings_field, hint)
        rows.append((f"{prefix}{key}", default, expected, settings_field.metadata["help"]))
    return reference_table(rows)


def reference_table(rows: Iterable[tuple[str, Any, str, str]]) -> str:
    """Return a Markdown table of settings, each with its key, default, expectation and meaning."""
    lines = ["| key | default | expected | meaning |", "|---|---|---|---|"]
    for key, default, expected, meaning in rows:
        simple = default is None or isinstance(default, bool | int | float | str)
        shown = f"`{as_written(default)}`" if simple else "see the group"
        lines.append(f"| `{key}` | {shown} | {expected} | {meaning} |")
    return "\n".join(lines) + "\n"


def _is_schema(hint: Any) -> bool:
    return isinstance(hint, type) and is_dataclass(hint)


def _kinds(hint: Any) -> tuple[type, ...]:
    """Return the plain types that a type hint allows, or nothing for one that allows anything."""
    members = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    return members if all(member in (*WORDS, type(None)) for member in members) else ()


def _has_kind(value: Any, kinds: Sequence[type]) -> bool:
    if isinstance(value, bool):
        return bool in kinds
    if isinstance(value, int):
        return int in kinds or float in kinds
    if isinstance(value, float):
        return float in kinds and math.isfinite(value)
    return isinstance(value, str) and str in kinds


def _in_range(value: Any, limits: Mapping[str, Any]) -> bool:
    if "choices" in limits:
        return value in limits["choices"]
    if isinstance(value, bool | str):
        return True
    return bool(
        value >= limits.get("at_least", -math.inf)
        and value <= limits.get("at_most", math.inf)
        and value > limits.get("above", -math.inf)
        and value < limits.get("below", math.inf)
    )
