"""Segments: exact numbers, gradients, degenerate segments, distances."""

import numpy as np
import pytest
import torch

from geoskill.geometry.segments import direction, distance_to_segment, is_degenerate, length, midpoint, reversed_ends


def test_length_midpoint_and_direction_of_a_3_4_5_segment() -> None:
    segment = torch.tensor([[1.0, 1.0, 4.0, 5.0]])
    assert length(segment).tolist() == [5.0]
    assert midpoint(segment).tolist() == [[2.5, 3.0]]
    torch.testing.assert_close(direction(segment), torch.tensor([[0.6, 0.8]]))
    assert reversed_ends(segment).tolist() == [[4.0, 5.0, 1.0, 1.0]]


@pytest.mark.parametrize("function", [length, midpoint, direction])
def test_degenerate_segment_is_finite_in_value_and_gradient(function) -> None:  # type: ignore[no-untyped-def]
    segment = torch.tensor([[7.0, 7.0, 7.0, 7.0], [0.0, 0.0, 3.0, 4.0]], requires_grad=True)
    assert is_degenerate(segment).tolist() == [True, False]
    value = function(segment)
    value.sum().backward()
    assert segment.grad is not None
    assert bool(value.isfinite().all())
    assert bool(segment.grad.isfinite().all())


def test_degenerate_segment_has_no_direction() -> None:
    point = torch.full((1, 4), 7.0)
    assert length(point).tolist() == [0.0]
    assert direction(point).tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_dtype_is_kept(dtype: torch.dtype) -> None:
    segment = torch.tensor([[1, 2, 3, 5]], dtype=dtype)
    assert {f(segment).dtype for f in (length, midpoint, direction)} == {dtype}


@pytest.mark.parametrize("function", [length, midpoint, direction])
def test_gradients(function) -> None:  # type: ignore[no-untyped-def]
    segment = torch.tensor([[1.0, 2.0, 7.0, -3.0], [5.0, 5.0, 4.0, 9.0]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(function, (segment,))


def test_distance_to_segment_is_that_of_the_nearest_point() -> None:
    segment = np.array([[0.0, 0.0, 10.0, 0.0]])
    points = np.array([[5.0, 3.0], [13.0, 4.0], [-6.0, -8.0], [10.0, 0.0]])
    assert distance_to_segment(points, segment).tolist() == [3.0, 5.0, 10.0, 0.0]


def test_distance_to_a_degenerate_segment_is_that_of_its_point() -> None:
    assert distance_to_segment(np.array([[4.0, 5.0]]), np.array([[1.0, 1.0, 1.0, 1.0]])).tolist() == [5.0]


def test_distance_to_segment_broadcasts() -> None:
    generator = np.random.default_rng(0)
    points, segments = generator.uniform(0, 100, (6, 2)), generator.uniform(0, 100, (4, 4))
    table = distance_to_segment(points[:, None], segments[None])
    assert table.shape == (6, 4)
    assert table[2, 3] == distance_to_segment(points[2:3], segments[3:4])[0]
