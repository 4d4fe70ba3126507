"""Segments and their carrier lines: exact numbers, homogeneous identities, degenerate segments."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from geoskill.geometry.segments import carrier_line, direction, is_degenerate, length, midpoint, reversed_ends

few_examples = settings(max_examples=40, deadline=None)

coordinate = st.floats(-2000, 2000, width=32)
segment_rows = st.lists(coordinate, min_size=4, max_size=4).map(lambda row: torch.tensor([row], dtype=torch.float64))


def test_length_midpoint_and_direction_of_a_3_4_5_segment() -> None:
    segment = torch.tensor([[1.0, 1.0, 4.0, 5.0]])
    assert length(segment).tolist() == [5.0]
    assert midpoint(segment).tolist() == [[2.5, 3.0]]
    torch.testing.assert_close(direction(segment), torch.tensor([[0.6, 0.8]]))
    assert reversed_ends(segment).tolist() == [[4.0, 5.0, 1.0, 1.0]]


@few_examples
@given(segment_rows)
def test_carrier_line_is_the_normalised_cross_product_of_the_homogeneous_end_points(segment: Tensor) -> None:
    if float(length(segment)) < 1e-2:
        return
    one = torch.ones(1, 1, dtype=torch.float64)
    first, second = torch.cat([segment[:, :2], one], dim=1), torch.cat([segment[:, 2:], one], dim=1)
    cross = torch.linalg.cross(first, second)
    expected = cross / cross[:, :2].norm()
    torch.testing.assert_close(carrier_line(segment), expected, rtol=1e-9, atol=1e-7)
    for point in (first, second):
        assert abs(float((carrier_line(segment) * point).sum())) < 1e-8


def test_carrier_line_flips_when_the_end_points_are_exchanged() -> None:
    segment = torch.tensor([[1.0, 2.0, 7.0, -3.0]], dtype=torch.float64)
    torch.testing.assert_close(carrier_line(reversed_ends(segment)), -carrier_line(segment))


@pytest.mark.parametrize("function", [length, midpoint, direction, carrier_line])
def test_degenerate_segment_is_finite_in_value_and_gradient(function) -> None:  # type: ignore[no-untyped-def]
    segment = torch.tensor([[7.0, 7.0, 7.0, 7.0], [0.0, 0.0, 3.0, 4.0]], requires_grad=True)
    assert is_degenerate(segment).tolist() == [True, False]
    value = function(segment)
    value.sum().backward()
    assert segment.grad is not None
    assert bool(value.isfinite().all())
    assert bool(segment.grad.isfinite().all())


def test_degenerate_segment_has_no_direction_and_no_line() -> None:
    point = torch.full((1, 4), 7.0)
    assert length(point).tolist() == [0.0]
    assert direction(point).tolist() == [[0.0, 0.0]]
    assert carrier_line(point).abs().tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_kept(dtype: torch.dtype) -> None:
    segment = torch.tensor([[1, 2, 3, 5]], dtype=dtype)
    assert {f(segment).dtype for f in (length, midpoint, direction, carrier_line)} == {dtype}


@pytest.mark.parametrize("function", [length, midpoint, direction, carrier_line])
def test_gradients(function) -> None:  # type: ignore[no-untyped-def]
    segment = torch.tensor([[1.0, 2.0, 7.0, -3.0], [5.0, 5.0, 4.0, 9.0]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(function, (segment,))
