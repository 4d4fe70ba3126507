"""What a confidence depends on."""

import pytest
import torch

from geoskill.model.confidence import PLATT_MIDPOINT, PLATT_SLOPE, confidences, score_margins


def test_by_hand() -> None:
    scores = torch.tensor([10.0, 2.0, 0.0])  # the mean is 4
    found = confidences(scores, torch.tensor(5.0))
    expected = torch.sigmoid(PLATT_SLOPE * (torch.tensor([6.0, -2.0, -4.0]) / 5.0 - PLATT_MIDPOINT))
    torch.testing.assert_close(found, expected)
    assert confidences(torch.tensor([PLATT_MIDPOINT * 3, 0.0, -PLATT_MIDPOINT * 3]), torch.tensor(3.0))[
        0
    ] == pytest.approx(0.5)


def test_it_knows_no_origin_and_no_unit_of_scores() -> None:
    scores = torch.randn(50, generator=torch.Generator().manual_seed(0)) * 7
    usual = score_margins(scores).max()
    torch.testing.assert_close(
        confidences(3 * scores + 100, 3 * usual), confidences(scores, usual), rtol=1e-4, atol=1e-5
    )


def test_without_a_usual_lead_it_is_the_select_out() -> None:
    scores = torch.tensor([1.0, 2.0, 3.0])
    torch.testing.assert_close(confidences(scores, torch.tensor(0.0)), torch.softmax(scores, 0))


def test_no_instance_and_one() -> None:
    assert confidences(torch.zeros(0), torch.tensor(1.0)).shape == (0,)
    assert confidences(torch.tensor([5.0]), torch.tensor(1.0)) < 0.01, "ahead of nothing"
