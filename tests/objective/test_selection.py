"""Select-out and the residual sum of weights."""

import pytest
import torch

from geoskill.objective.selection import residual_sum_of_weights, select_out

COUNTS = torch.tensor([3, 0, 5, 1, 12, 0])
BATCH = torch.arange(6).repeat_interleave(COUNTS)


def random_scores(dtype: torch.dtype = torch.float32) -> torch.Tensor:
    return 3 * torch.randn(len(BATCH), generator=torch.Generator().manual_seed(0), dtype=dtype)


def test_select_out_is_a_softmax_of_every_frame() -> None:
    scores = random_scores()
    g = select_out(scores, BATCH, 6)
    for frame in range(6):
        torch.testing.assert_close(g[frame == BATCH], torch.softmax(scores[frame == BATCH], dim=0))


def test_select_out_ignores_a_constant_and_survives_huge_scores() -> None:
    batch = torch.tensor([0, 0, 1, 1])
    g = select_out(torch.tensor([1e5, 1e5, -1e5, 1e5]), batch, 2)
    torch.testing.assert_close(g, torch.tensor([0.5, 0.5, 0.0, 1.0]))


def test_residual_sum_of_weights_by_hand() -> None:
    g = torch.tensor([0.5, 0.125, 0.375, 0.5, 0.25, 0.25, 1.0])
    batch = torch.tensor([0, 0, 0, 1, 1, 1, 3])
    assert residual_sum_of_weights(g, batch, 5, 1).tolist() == [0.5, 0.5, 0.0, 0.0, 0.0]
    assert residual_sum_of_weights(g, batch, 5, 2).tolist() == [0.125, 0.25, 0.0, 0.0, 0.0]
    assert residual_sum_of_weights(g, batch, 5, 3).tolist() == [0.0] * 5
    assert residual_sum_of_weights(g, batch, 5, 50).tolist() == [0.0] * 5


@pytest.mark.parametrize("top_k", [1, 2, 4, 10, 12])
def test_residual_sum_of_weights_equals_one_minus_the_largest(top_k: int) -> None:
    g = select_out(random_scores(torch.float64), BATCH, 6)
    expected = [
        1 - float(g[frame == BATCH].sort(descending=True).values[:top_k].sum()) if COUNTS[frame] else 0.0
        for frame in range(6)
    ]
    rsw = residual_sum_of_weights(g, BATCH, 6, top_k)
    torch.testing.assert_close(rsw, torch.tensor(expected, dtype=torch.float64))
    assert bool((rsw[top_k >= COUNTS] == 0).all()), "exactly, not up to rounding"


def test_residual_sum_of_weights_of_a_uniform_selection() -> None:
    g = torch.full((40,), 1 / 40)
    rsw = residual_sum_of_weights(g, torch.zeros(40, dtype=torch.long), 1, 10)
    torch.testing.assert_close(rsw, torch.tensor([0.75]))


def test_residual_sum_of_weights_keeps_small_values_in_float32() -> None:
    g = torch.tensor([1.0, 3e-9, 2e-9])
    rsw = residual_sum_of_weights(g, torch.zeros(3, dtype=torch.long), 1, 1)
    torch.testing.assert_close(rsw, torch.tensor([5e-9]), rtol=1e-6, atol=0)


def test_selection_without_instances() -> None:
    nothing = torch.zeros(0)
    batch = torch.zeros(0, dtype=torch.long)
    assert select_out(nothing, batch, 3).shape == (0,)
    assert residual_sum_of_weights(nothing, batch, 3, 10).tolist() == [0.0, 0.0, 0.0]


def test_selection_gradients() -> None:
    scores = random_scores(torch.float64).requires_grad_()
    assert torch.autograd.gradcheck(lambda s: select_out(s, BATCH, 6), (scores,))
    assert torch.autograd.gradcheck(lambda s: residual_sum_of_weights(select_out(s, BATCH, 6), BATCH, 6, 2), (scores,))


def test_residual_sum_of_weights_gradient() -> None:
    scores = random_scores(torch.float64)[-12:].requires_grad_()
    batch = torch.zeros(12, dtype=torch.long)
    residual_sum_of_weights(select_out(scores, batch, 1), batch, 1, 3).sum().backward()
    reference = scores.detach().clone().requires_grad_()
    (1 - torch.softmax(reference, dim=0).topk(3).values.sum()).backward()
    torch.testing.assert_close(scores.grad, reference.grad)
