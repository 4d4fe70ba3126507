"""Confidence of associations from the margins of their scores."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from geoskill.model.confidence import (
    FAMILIARITY_MIDPOINT,
    FAMILIARITY_SLOPE,
    PLATT_MIDPOINT,
    PLATT_SLOPE,
    confidences,
    score_margins,
)


def test_confidences_by_hand() -> None:
    scores = torch.tensor([10.0, 2.0, 0.0])  # the mean is 4
    values = confidences(scores, torch.tensor(5.0))
    expected = torch.sigmoid(PLATT_SLOPE * (torch.tensor([6.0, -2.0, -4.0]) / 5.0 - PLATT_MIDPOINT))
    torch.testing.assert_close(values, expected)
    assert confidences(torch.tensor([PLATT_MIDPOINT * 3, 0.0, -PLATT_MIDPOINT * 3]), torch.tensor(3.0))[
        0
    ] == pytest.approx(0.5)


def test_confidences_above_the_level_of_the_demonstration_by_hand() -> None:
    scores, margin, level = torch.tensor([10.0, 2.0, 0.0]), torch.tensor(5.0), torch.tensor(9.0)
    familiar = torch.sigmoid(FAMILIARITY_SLOPE * (torch.tensor([1.0, -7.0, -9.0]) / 5.0 - FAMILIARITY_MIDPOINT))
    torch.testing.assert_close(confidences(scores, margin, level), confidences(scores, margin) * familiar)


@given(shift=st.floats(-100, 100), scale=st.floats(0.1, 10), level=st.floats(-50, 50))
def test_level_only_lowers_confidences_and_moves_with_the_scores(shift: float, scale: float, level: float) -> None:
    scores = torch.randn(50, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 7
    margin, known = score_margins(scores).max(), torch.tensor(level, dtype=torch.float64)
    lowered = confidences(scores, margin, known)
    assert bool((lowered <= confidences(scores, margin)).all())
    moved = confidences(scale * scores + shift, scale * margin, scale * known + shift)
    torch.testing.assert_close(moved, lowered, rtol=1e-6, atol=1e-9)


def test_confidences_are_invariant_to_shift_and_scale_of_scores() -> None:
    scores = torch.randn(50, generator=torch.Generator().manual_seed(0)) * 7
    margin = score_margins(scores).max()
    torch.testing.assert_close(
        confidences(3 * scores + 100, 3 * margin), confidences(scores, margin), rtol=1e-4, atol=1e-5
    )


def test_confidences_without_reference_margin_are_the_select_out() -> None:
    scores = torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(confidences(scores, torch.tensor(0.0)), torch.softmax(scores, 0))


def test_confidences_of_no_instance_and_of_one() -> None:
    assert confidences(torch.zeros(0), torch.tensor(1.0)).shape == (0,)
    assert confidences(torch.tensor([5.0]), torch.tensor(1.0)) < 0.01, "it has no margin"
