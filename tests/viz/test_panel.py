"""Tests of the panel's text."""

from dataclasses import replace

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Goal, Node
from geoskill.skill.member_status import State
from geoskill.viz import panel
from geoskill.viz.drawing import Scale
from geoskill.viz.panel import Block, draw_panel

SCALE = Scale(1, 1.0, 1.0)
SIZE = (480, 160)


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the list of the texts drawn on panels."""
    texts: list[str] = []
    original = panel.draw_text

    def listening(canvas: np.ndarray, text: str, *rest: object) -> None:
        texts.append(text)
        original(canvas, text, *rest)

    monkeypatch.setattr(panel, "draw_text", listening)
    return texts


def association(rank: int = 1, unit: str = "px") -> Association:
    nodes = (Node(NodeType.LINE, (1.0, 1.0, 20.0, 1.0)), Node(NodeType.LINE, (1.0, 9.0, 20.0, 30.0)))
    return Association("par_lbd", "par", "lbd", rank, 0.9, 0.9, nodes, (0.5,), unit)


@pytest.mark.parametrize(("unit", "norm"), [("", "|E| 0.50"), ("px", "|E| 0.50 px"), ("m", "|E| 500.0 mm")])
def test_panel_prints_error_with_its_unit(printed: list[str], unit: str, norm: str) -> None:
    draw_panel(*SIZE, SCALE, [Block("par lbd", [association(unit=unit)])], "frame 0", "", [])
    assert [text for text in printed if text.startswith("|E|")] == [norm]


def test_panel_says_how_many_bars_do_not_fit(printed: list[str]) -> None:
    blocks = [Block("par lbd", [association(rank) for rank in range(1, 41)])]
    drawn = draw_panel(*SIZE, SCALE, blocks, "frame 0", "", [])
    assert drawn.shape == (480, 160, 3)
    bars = sum(text == "90%" for text in printed)
    assert 0 < bars < 40
    assert printed[-1] == f"and {40 - bars} more"


def test_panel_of_member_without_instance(printed: list[str]) -> None:
    draw_panel(*SIZE, SCALE, [Block("par lbd", [])], "frame 3", "title", ["par_lbd: no instance: 0 lines found"])
    assert {"title", "frame 3", "par lbd", "no instance"} <= set(printed)
    assert " ".join(printed).endswith("par_lbd: no instance: 0 lines found")


def test_panel_prints_state_and_way_to_go(printed: list[str]) -> None:
    goal = Goal((None, (1.0, 2.0, 30.0, 4.0)), (0.25,), (0.1,))
    block = Block("par lbd", [replace(association(), goal=goal)], State.AT_GOAL)
    draw_panel(*SIZE, SCALE, [block], "#3  0.10 s", "", [])
    assert printed[:4] == ["#3  0.10 s", "par lbd", "at goal", "|E| 0.50 px"]
    assert "to go 0.25 px" in printed


def test_panel_prints_whole_lines_of_usual_errors(printed: list[str]) -> None:
    """Nothing of four members with errors of three digits is cut short, at the height of a picture of 16:9."""
    nodes = (Node(NodeType.POINT, (1.0, 1.0)), Node(NodeType.POINT, (9.0, 9.0)))
    top = Association("p2p_sift", "p2p", "sift+lbd", 1, 0.9, 0.9, nodes, (-250.8, -130.6))
    draw_panel(370, 160, SCALE, [Block("A p2p sift+lbd", [top], State.APPROACHING)] * 4, "#1234  41.13 s", "", [])
    assert not [text for text in printed if text.endswith("...")]
