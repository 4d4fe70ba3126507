"""Names with numbers in them: pictures counted, named by their time, and what may be either."""

import random
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.io.file_order import in_order


def shuffled(stems: list[str]) -> list[str]:
    return random.Random(0).sample(stems, len(stems))


@pytest.mark.parametrize(
    "stems",
    [
        [f"{1700000000 + i / 30}" for i in range(205)],  # Python drops trailing zeros: 1700000000.1 after .0666666
        [f"{i / 30}" for i in range(205)],
        [f"{i * 1e-5}" for i in range(205)],  # the first ones are written as 1e-05
        [f"left_{i / 30}_color" for i in range(205)],
        [f"{i / 30:.6f}" for i in range(205)],
        [f"frame{i}" for i in range(205)],
        [f"frame{i:06d}" for i in range(205)],
        [f"2024.01.05_10.30.{i}" for i in range(60)],  # a date, whose numbers are no decimals
        [f"scene.{i}" for i in range(20)],
        ["a", "b", "c"],
    ],
    ids=lambda stems: stems[-1],
)
def test_clear_names(stems: list[str]) -> None:
    assert in_order(shuffled(stems)) == (stems, None)


def test_decimals_that_could_be_parts_are_told() -> None:
    order, ambiguity = in_order(["1.5", "1.25"])
    assert order == ["1.25", "1.5"]
    assert ambiguity is not None
    assert ambiguity.startswith(
        "numbers such as that of '1.25' are read as decimal numbers, not as parts: the order is"
    )


def test_parts_that_could_be_decimals_are_told() -> None:
    # No program that leaves out zeros writes 1.10.
    order, ambiguity = in_order(["1.10", "1.9", "1.11"])
    assert order == ["1.9", "1.10", "1.11"]
    assert ambiguity is not None
    assert "'1.9' are read as parts, not as decimal numbers: the order is 1.9, 1.10, 1.11" in ambiguity


@pytest.mark.parametrize("write", [str, repr, "{:.3f}".format], ids=["str", "repr", "fixed"])
@given(values=st.lists(st.integers(0, 10**7), min_size=1, unique=True))
def test_order_of_written_times_is_that_of_their_values(write: Callable[[float], str], values: list[int]) -> None:
    times = [value / 1000 for value in values]
    order, ambiguity = in_order([write(time) for time in times])
    if ambiguity is None or "as decimal numbers, not" in ambiguity:
        assert order == [write(time) for time in sorted(times)]


@given(st.lists(st.text(min_size=1), unique=True))
def test_any_names_are_ordered_whatever_order_they_come_in(stems: list[str]) -> None:
    order, _ = in_order(stems)
    assert sorted(order) == sorted(stems)
    assert in_order(stems[::-1])[0] == order
