"""Settings that document and check themselves."""

import doctest
import math
import re
from dataclasses import dataclass, field
from typing import Any

import pytest

from geoskill import schema
from geoskill.config import Config
from geoskill.errors import InputError
from geoskill.schema import (
    as_plain,
    as_written,
    check_fields,
    check_value,
    default_of,
    expectation,
    flatten,
    markdown_table,
    setting,
    settings_of,
)


@dataclass
class Inner(Config):
    """One that is nested in another."""

    size: int = setting(1, "Size.", at_least=1)
    share: float | None = setting(None, "Share.", above=0, below=1)


@dataclass
class Outer(Config):
    """One of every kind."""

    switch: bool = setting(False, "Switch.")
    count: int = setting(0, "Count.", at_least=0, at_most=9)
    ratio: float = setting(1.0, "Ratio.", above=0)
    limit: int | float | None = setting(25, "Limit.", above=0)
    word: str = setting("a", "Word.")
    choice: str = setting("red", "Choice.", choices=("red", "green", "blue"))
    names: Any = setting(lambda: ["a", "b"], "Anything.")
    inner: Inner = field(default_factory=Inner)


SETTINGS = {key: (own, hint) for key, own, hint in flatten(Outer)}


@pytest.mark.parametrize(("name", "example"), [(test.name, test) for test in doctest.DocTestFinder().find(schema)])
def test_examples(name: str, example: doctest.DocTest) -> None:
    assert doctest.DocTestRunner().run(example).failed == 0, name


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("switch", [True, False]),
        ("count", [0, 9]),
        ("ratio", [1, 1.5, 1e-300]),
        ("limit", [None, 25, 0.5]),
        ("word", ["", "a b", "1"]),
        ("choice", ["red", "green", "blue"]),
        ("names", [None, [], {"a": 1}, math.nan, object()]),
        ("inner.size", [1, 10**30]),
        ("inner.share", [None, 0.5, 1e-9, 1 - 1e-9]),
    ],
)
def test_values_in_range(key: str, values: list[Any]) -> None:
    for value in values:
        check_value(key, value, *SETTINGS[key])


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("switch", [0, 1, 0.0, "true", "yes", None, []], "true or false"),
        (
            "count",
            [-1, 10, 1.0, 1.5, "1", True, False, None, math.nan, math.inf, [1]],
            "a whole number of at least 0 and at most 9",
        ),
        ("ratio", [0, 0.0, -1, "1", True, None, math.nan, math.inf, -math.inf, 1j, (1,)], "a number above 0"),
        ("limit", [0, -0.5, True, "x", math.nan, math.inf], "a whole number or a number above 0, or null"),
        ("word", [1, 1.5, True, None, b"a", ["a"]], "text"),
        ("choice", ["Red", "", "yellow", None, 1, True], "red, green or blue"),
        ("inner.size", [0, -1, 1.0], "a whole number of at least 1"),
        ("inner.share", [0, 0.0, 1, 1.0, -0.1, 1.1, False, "0.5", math.nan], "a number above 0 and below 1, or null"),
    ],
)
def test_values_of_a_wrong_type_or_out_of_range(key: str, values: list[Any], expected: str) -> None:
    assert expectation(*SETTINGS[key]) == expected
    for value in values:
        with pytest.raises(InputError, match=rf"^{re.escape(f'{key}={as_written(value)}: expected {expected}')}$"):
            check_value(key, value, *SETTINGS[key])


@pytest.mark.parametrize(
    ("limits", "inside", "outside", "expected"),
    [
        ({"at_least": 2}, [2, 3], [1, 1.999], "a number of at least 2"),
        ({"at_most": 2}, [2, -3], [3, 2.001], "a number of at most 2"),
        ({"above": 2}, [2.001, 3], [2, 1], "a number above 2"),
        ({"below": 2}, [1.999, -3], [2, 3], "a number below 2"),
        ({"above": 0, "at_most": 1}, [1, 0.1], [0, 1.1], "a number above 0 and at most 1"),
        ({"at_least": 1e-3, "below": 1e6}, [1e-3], [0, 1e6], "a number of at least 0.001 and below 1e+06"),
        ({}, [0, -1e300], [math.inf], "a number"),
    ],
)
def test_limits(limits: dict[str, float], inside: list[float], outside: list[float], expected: str) -> None:
    own = setting(0.0, "A number.", **limits)
    assert own.metadata["help"] == "A number."
    assert expectation(own, float) == expected
    for value in inside:
        check_value("x", value, own, float)
    for value in outside:
        with pytest.raises(InputError, match=r"^x="):
            check_value("x", value, own, float)


def test_limits_of_zero_and_a_single_choice_count() -> None:
    own = setting("a", "Word.", choices=("a",))
    assert expectation(own, str) == "a"
    with pytest.raises(InputError, match=r"^x=b: expected a$"):
        check_value("x", "b", own, str)
    assert dict(setting(0, "Number.", at_least=0).metadata) == {"help": "Number.", "at_least": 0}


def test_defaults_are_values_or_made_anew() -> None:
    defaults = {name: default_of(own) for name, own, _ in settings_of(Outer)}
    assert defaults == {
        "switch": False,
        "count": 0,
        "ratio": 1.0,
        "limit": 25,
        "word": "a",
        "choice": "red",
        "names": ["a", "b"],
        "inner": Inner(),
    }
    assert default_of(SETTINGS["names"][0]) is not default_of(SETTINGS["names"][0])


def test_fields_are_checked_when_a_configuration_is_made() -> None:
    check_fields(Outer())
    with pytest.raises(InputError, match=r"^count=10: expected a whole number of at least 0 and at most 9$"):
        Outer(count=10)
    with pytest.raises(InputError, match=r"^size=0: expected a whole number of at least 1$"):
        Outer(inner=Inner(size=0))


@pytest.mark.parametrize("value", [1, None, {"size": 1}, Outer])
def test_nested_configurations_are_of_their_class(value: Any) -> None:
    own, hint = next((own, hint) for name, own, hint in settings_of(Outer) if name == "inner")
    check_value("inner", Inner(), own, hint)
    with pytest.raises(InputError, match=r"^inner=.+: expected Inner$"):
        check_value("inner", value, own, hint)


def test_flatten() -> None:
    assert list(SETTINGS) == [
        *("switch", "count", "ratio", "limit", "word", "choice", "names"),
        *("inner.size", "inner.share"),
    ]
    assert [key for key, _, _ in flatten(Inner, "a.b.")] == ["a.b.size", "a.b.share"]
    assert SETTINGS["inner.share"][0].metadata["help"] == "Share."
    assert SETTINGS["inner.share"][1] == float | None


def test_as_plain() -> None:
    plain = as_plain(Outer(names={"one": Inner(2), 2: ("x", [Inner(3, 0.5)])}))
    assert plain == {
        "switch": False,
        "count": 0,
        "ratio": 1.0,
        "limit": 25,
        "word": "a",
        "choice": "red",
        "names": {"one": {"size": 2, "share": None}, "2": ["x", [{"size": 3, "share": 0.5}]]},
        "inner": {"size": 1, "share": None},
    }
    assert as_plain(None) is None
    assert as_plain("ab") == "ab"
    assert as_plain(Inner) is Inner  # a class is no configuration


def test_markdown_table() -> None:
    assert markdown_table(Outer, "my.").splitlines() == [
        "| key | default | expected | meaning |",
        "|---|---|---|---|",
        "| `my.switch` | `false` | true or false | Switch. |",
        "| `my.count` | `0` | a whole number of at least 0 and at most 9 | Count. |",
        "| `my.ratio` | `1.0` | a number above 0 | Ratio. |",
        "| `my.limit` | `25` | a whole number or a number above 0, or null | Limit. |",
        "| `my.word` | `a` | text | Word. |",
        "| `my.choice` | `red` | red, green or blue | Choice. |",
        "| `my.names` | see the group | a value | Anything. |",
        "| `my.inner.size` | `1` | a whole number of at least 1 | Size. |",
        "| `my.inner.share` | `null` | a number above 0 and below 1, or null | Share. |",
    ]
