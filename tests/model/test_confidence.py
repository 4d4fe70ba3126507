"""Confidence of associations from the margins of their scores."""

import pytest
import torch

from geoskill.model.confidence import PLATT_MIDPOINT, PLATT_SLOPE, confidences, score_margins


def test_confidences_by_hand() -> None:
    scores = torch.tensor([10.0, 2.0, 0.0])  # the mean is 4
    values = confidences(scores, torch.tensor(5.0))
    expected = torch.sigmoid(PLATT_SLOPE * (torch.tensor([6.0, -2.0, -4.0]) / 5.0 - PLATT_MIDPOINT))
    torch.testing.assert_close(values, expected)
    assert confidences(torch.tensor([PLATT_MIDPOINT * 3, 0.0, -PLATT_MIDPOINT * 3]), torch.tensor(3.0))[
        0
    ] == pytest.approx(0.5)


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
