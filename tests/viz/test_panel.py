"""Tests of the panel's text."""

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node
from geoskill.viz import panel
from geoskill.viz.drawing import Scale
from geoskill.viz.panel import Block, draw_panel

SCALE = Scale(1, 1.0)


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


@pytest.mark.parametrize(("unit", "norm"), [("", "|E| = 0.50"), ("px", "|E| = 0.50 px")])
def test_panel_prints_error_with_its_unit(printed: list[str], unit: str, norm: str) -> None:
    draw_panel(480, SCALE, [Block("par lbd", [association(unit=unit)])], "frame 0", "", [])
    assert [text for text in printed if text.startswith("|E|")] == [norm]


def test_panel_says_how_many_bars_do_not_fit(printed: list[str]) -> None:
    blocks = [Block("par lbd", [association(rank) for rank in range(1, 41)])]
    drawn = draw_panel(480, SCALE, blocks, "frame 0", "", [])
    assert drawn.shape == (480, 272, 3)
    bars = sum(text == "90.0%" for text in printed)
    assert 0 < bars < 40
    assert printed[-1] == f"and {40 - bars} more"


def test_panel_of_member_without_instance(printed: list[str]) -> None:
    draw_panel(480, SCALE, [Block("par lbd", [])], "frame 3", "title", ["par_lbd: no instance: 0 lines found"])
    assert {"title", "frame 3", "par lbd", "no instance"} <= set(printed)
    assert " ".join(printed).endswith("par_lbd: no instance: 0 lines found")
