"""Tests of the sentences of a task definition."""

import doctest

import pytest

from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.par import Parallel
from geoskill.skill import sentences
from geoskill.skill.association import NodeRole
from geoskill.skill.sentences import NOTHING, constraint_sentence, task_sentence

MOVING, RESTING = NodeRole.MOVING, NodeRole.RESTING


def test_examples() -> None:
    assert doctest.testmod(sentences).failed == 0


@pytest.mark.parametrize(
    ("kernel", "roles", "nodes"),
    [
        (PointToLine(), (MOVING, RESTING), "a moved point and a resting line"),
        (PointToLine(), (RESTING, MOVING), "a resting point and a moved line"),
        (LineToLine(), (MOVING, RESTING), "a moved line and a resting line"),
        (LineToLine(), (None, None), "2 lines"),
    ],
)
def test_sentence_names_what_moves_and_what_rests(
    kernel: Kernel, roles: tuple[NodeRole | None, ...], nodes: str
) -> None:
    assert f": {nodes}, done within" in constraint_sentence(kernel, roles, 1.0, 0.5, True)


def test_sentence_of_what_is_not_known() -> None:
    sentence = constraint_sentence(Parallel(), (MOVING, RESTING), None, None, True)
    assert "how near is not known; not seen in this video; left free: motion without turning" in sentence
    assert "0.02;" in constraint_sentence(Parallel(), (MOVING, RESTING), 0.02, 0.5, True)  # an error without unit
    assert constraint_sentence(PointToPoint(), (None, None), 3.0, 0.9, False).startswith("Nothing was learned")


def test_task_of_no_member_and_of_like_ones() -> None:
    assert task_sentence([]) == task_sentence([[]]) == NOTHING
    assert task_sentence([[PointToPoint(), PointToPoint()]]) == "A thing is moved until one point comes onto another."
    both = task_sentence([[PointToPoint(), LineToLine()]])
    assert both == "A thing is moved until one point comes onto another and one line comes to lie on another."
