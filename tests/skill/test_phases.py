"""Phases of a task, by hand."""

from typing import Any

import pytest

from geoskill.control.settling import Settling
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.l2l import LineToLine
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.skill.phases import phases_of, timeline


def members(**shares: float | None) -> dict[str, KernelModel]:
    found = {}
    for name, share in shares.items():
        scorer = Bilinear(Motif.of(LineToLine(), {NodeType.LINE: 4}), hidden_dim=2)
        found[name] = KernelModel(LineToLine(), {NodeType.LINE: "lbd"}, scorer)
        if share is not None:
            found[name].set_settling(Settling(share, 3.0, 1.8))
    return found


def test_phases_in_their_order() -> None:
    first, second = phases_of(members(p2p_sift=0.8, l2l_lbd=0.7, par_lbd=0.66))
    assert first.as_plain() == {
        "members": ["par_lbd", "l2l_lbd"],
        "settles_at": 0.7,
        "until": {"par_lbd": 6.0, "l2l_lbd": 6.0},
        "error_at_end": {"par_lbd": 1.8, "l2l_lbd": 1.8},
    }
    assert second.as_plain()["members"] == ["p2p_sift", "par_lbd", "l2l_lbd"]
    assert (second.held, list(second.settling)) == (("par_lbd", "l2l_lbd"), ["p2p_sift"])


@pytest.mark.parametrize(
    ("shares", "sizes"),
    [
        ({"a": 0.50, "b": 0.54}, [2]),
        ({"a": 0.50, "b": 0.56}, [1, 1]),
        ({"a": 0.50, "b": 0.54, "c": 0.58}, [2, 1]),  # a phase does not grow along a chain
        ({"a": 0.50, "b": None}, [1]),
        ({"a": None}, []),
        ({}, []),
    ],
)
def test_phases_hold_what_settles_together(shares: dict[str, Any], sizes: list[int]) -> None:
    assert [len(phase.settling) for phase in phases_of(members(**shares))] == sizes


def test_timeline_has_a_bar_for_each_member() -> None:
    assert timeline(phases_of(members(p2p_sift=1.0, l2l_lbd=0.5))) == [
        f"l2l_lbd   {'#' * 20}{'.' * 20}  settles at 50 %",
        f"p2p_sift  {'#' * 40}  settles at 100 %",
    ]
    assert timeline(()) == []
