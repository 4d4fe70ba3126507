"""Control errors: hand-computed numbers, zero exactly at the constraint, symmetries and invariances."""

import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from geoskill.geometry.control_errors import error_norm, line_to_line, parallel, point_to_line, point_to_point
from geoskill.geometry.segments import length, reversed_ends

few_examples = settings(max_examples=40, deadline=None)

coordinate = st.floats(-1000, 1000)
angle = st.floats(-math.pi, math.pi)
half_length = st.floats(5, 200)
SEGMENT_ERRORS = [line_to_line, parallel]


def row(*numbers: float) -> Tensor:
    return torch.tensor([numbers], dtype=torch.float64)


def segment_at(x: float, y: float, angle_rad: float, half: float) -> Tensor:
    dx, dy = half * math.cos(angle_rad), half * math.sin(angle_rad)
    return row(x - dx, y - dy, x + dx, y + dy)


segments = st.builds(segment_at, coordinate, coordinate, angle, half_length)
points = st.builds(row, coordinate, coordinate)


def moved(segment_or_point: Tensor, angle_rad: float, x: float, y: float) -> Tensor:
    """Rotate about the origin, then shift."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    rotation = torch.tensor([[c, -s], [s, c]], dtype=torch.float64)
    ends = segment_or_point.reshape(-1, 2) @ rotation.T + torch.tensor([x, y], dtype=torch.float64)
    return ends.reshape(segment_or_point.shape)


def slid(segment: Tensor, start: float, end: float) -> Tensor:
    """Return another segment of the same carrier and direction: the same homogeneous line at another scale."""
    along = segment[:, 2:] - segment[:, :2]
    return torch.cat([segment[:, :2] + start * along, segment[:, :2] + end * along], dim=1)


def homogeneous_line(segment: Tensor) -> Tensor:
    """Return the line through both end points, their cross product (Hartley and Zisserman, section 2.2).

    Scaled so that (l1, l2) is a unit normal that points to the right of the direction from the first end to the second.
    """
    one = torch.ones(1, 1, dtype=torch.float64)
    ends = (torch.cat([end, one], dim=1) for end in (segment[:, :2], segment[:, 2:]))
    line = torch.linalg.cross(*ends)
    return line / line[:, :2].norm()


def test_error_norm_is_euclidean() -> None:
    assert error_norm(torch.tensor([[3.0, -4.0], [0.0, 0.0]])).tolist() == [5.0, 0.0]
    assert error_norm(torch.tensor([[-2.0], [3.0]])).tolist() == [2.0, 3.0]


def test_error_norm_has_a_zero_gradient_at_zero_and_the_unit_vector_elsewhere() -> None:
    errors = torch.tensor([[0.0, 0.0], [3.0, -4.0]], requires_grad=True)
    error_norm(errors).sum().backward()
    torch.testing.assert_close(errors.grad, torch.tensor([[0.0, 0.0], [0.6, -0.8]]))


def test_point_to_point_is_the_difference() -> None:
    x, y = row(101.5, 66.0), row(75.5, 141.0)
    assert point_to_point(x, y).tolist() == [[26.0, -75.0]]
    assert point_to_point(y, x).tolist() == [[-26.0, 75.0]]


def test_point_to_line_is_a_signed_pixel_distance() -> None:
    segment = row(0.0, 3.0, 5.0, 3.0)
    assert point_to_line(row(9.0, 7.0), segment).tolist() == [[4.0]], "below on the screen is to the right"
    assert point_to_line(row(9.0, 1.0), segment).tolist() == [[-2.0]]
    assert point_to_line(row(9.0, 1.0), reversed_ends(segment)).tolist() == [[2.0]]
    # the line 3x - 4y = 0, walked down to the right; (5, 0) lies 15/5 to its left
    torch.testing.assert_close(point_to_line(row(5.0, 0.0), row(0.0, 0.0, 8.0, 6.0)), row(-3.0))


@few_examples
@given(points, segments)
def test_point_to_line_equals_the_homogeneous_form_of_any_scale(x: Tensor, segment: Tensor) -> None:
    line = -7.3 * homogeneous_line(segment)
    homogeneous = torch.cat([2.5 * x, row(2.5)], dim=1)
    expected = (line * homogeneous).sum() / (2.5 * line[:, :2].norm())
    assert float(point_to_line(x, segment)) == pytest.approx(-float(expected), abs=1e-6)


@few_examples
@given(points, segments, st.floats(-3, 3), st.floats(0.1, 3))
def test_point_to_line_depends_only_on_the_oriented_carrier(x: Tensor, s: Tensor, start: float, extent: float) -> None:
    expected = point_to_line(x, s)
    torch.testing.assert_close(point_to_line(x, slid(s, start, start + extent)), expected, rtol=0, atol=1e-6)
    torch.testing.assert_close(point_to_line(x, reversed_ends(s)), -expected, rtol=0, atol=1e-6)


@few_examples
@given(segments, st.floats(-3, 3), st.floats(0.01, 500))
def test_point_to_line_is_zero_exactly_on_the_carrier(segment: Tensor, position: float, offset: float) -> None:
    on_carrier = slid(segment, position, position + 1)[:, :2]
    assert abs(float(point_to_line(on_carrier, segment))) < 1e-9
    beside = on_carrier + offset * homogeneous_line(segment)[:, :2]
    assert float(point_to_line(beside, segment)) == pytest.approx(offset, abs=1e-6)


def test_point_to_a_degenerate_segment_is_the_distance_to_it() -> None:
    assert point_to_line(row(4.0, 5.0), row(1.0, 1.0, 1.0, 1.0)).tolist() == [[5.0]]


def test_line_to_line_of_parallel_lines_is_their_distance_with_its_sign() -> None:
    first = row(0.0, 0.0, 10.0, 0.0)
    assert line_to_line(first, row(20.0, 4.0, 30.0, 4.0)).tolist() == [[4.0, 4.0]]
    assert line_to_line(first, row(30.0, 4.0, 20.0, 4.0)).tolist() == [[4.0, 4.0]]
    assert line_to_line(first, row(20.0, -4.0, 30.0, -4.0)).tolist() == [[-4.0, -4.0]]


def test_line_to_line_of_a_tilted_line_by_hand() -> None:
    # e: the end points (0, 0) and (4, 3) lie 0 and 3 right of the x axis; f: the end points (0, 0) and (10, 0) lie 0
    # and -6 right of the line 3x = 4y. (e - f)/2 = (0, 4.5), (e + f)/2 = (0, -1.5), sin² = 0.36:
    # the second component becomes sqrt(4.5² + 0.36 · 1.5²).
    error = line_to_line(row(0.0, 0.0, 10.0, 0.0), row(0.0, 0.0, 4.0, 3.0))
    torch.testing.assert_close(error, row(0.0, math.sqrt(20.25 + 0.81)))


@few_examples
@given(segments, st.floats(-3, 3), st.floats(0.1, 3), st.booleans())
def test_line_to_line_is_zero_when_collinear(segment: Tensor, start: float, extent: float, turned: bool) -> None:
    other = slid(segment, start, start + extent)
    assert float(error_norm(line_to_line(segment, reversed_ends(other) if turned else other))) < 1e-8


@few_examples
@given(segments, segments)
def test_line_to_line_is_zero_only_when_collinear(first: Tensor, second: Tensor) -> None:
    # |E2 - E1| = |sin| (sum of the half lengths), and for parallel lines |E1| is their distance: both are bounded
    # from below unless the carriers agree.
    norm = float(error_norm(line_to_line(first, second)))
    half_lengths = float(length(first) + length(second)) / 2
    assert norm >= abs(float(parallel(first, second))) * half_lengths / math.sqrt(2) - 1e-9
    parallel_second = torch.cat([second[:, :2], second[:, :2] + first[:, 2:] - first[:, :2]], dim=1)
    distance = abs(float(point_to_line(second[:, :2], first)))
    assert float(error_norm(line_to_line(first, parallel_second))) == pytest.approx(math.sqrt(2) * distance, abs=1e-6)


@few_examples
@given(segments, segments)
def test_line_to_line_norm_is_symmetric_and_ignores_the_order_of_end_points(first: Tensor, second: Tensor) -> None:
    expected = error_norm(line_to_line(first, second))
    for first_line, second_line in (
        (second, first),
        (reversed_ends(first), second),
        (first, reversed_ends(second)),
        (reversed_ends(second), reversed_ends(first)),
    ):
        torch.testing.assert_close(error_norm(line_to_line(first_line, second_line)), expected, rtol=1e-6, atol=1e-6)


@few_examples
@given(segments, segments)
def test_line_to_line_vector_changes_as_documented(first: Tensor, second: Tensor) -> None:
    cosine = float((first[:, 2:] - first[:, :2]) @ (second[:, 2:] - second[:, :2]).T / length(first) / length(second))
    if abs(cosine) < 1e-6:
        return
    error = line_to_line(first, second)
    torch.testing.assert_close(line_to_line(first, reversed_ends(second)), error, rtol=0, atol=1e-6)
    torch.testing.assert_close(line_to_line(reversed_ends(first), second), -error.flip(1), rtol=0, atol=1e-6)
    swapped = -error if cosine > 0 else error.flip(1)
    torch.testing.assert_close(line_to_line(second, first), swapped, rtol=0, atol=1e-6)


@few_examples
@given(coordinate, coordinate, half_length, half_length)
def test_line_to_line_norm_is_continuous_where_the_second_turns_round(x: float, y: float, p: float, q: float) -> None:
    first = segment_at(0, 0, 0, p)
    before, after = (
        float(error_norm(line_to_line(first, segment_at(x, y, math.pi / 2 + tilt, q)))) for tilt in (-1e-7, 1e-7)
    )
    assert before == pytest.approx(after, abs=0.01)
    # at 90°: e = y ± q on the first, f = x ± p on the second
    root_mean = math.sqrt(y * y + q * q + x * x + p * p)
    assert before == pytest.approx(root_mean, abs=0.01)


def test_line_to_line_is_the_plain_symmetric_mean_to_third_order_near_collinearity() -> None:
    first = segment_at(0, 0, 0, 50)
    for tilt_rad, tolerance in ((1e-2, 1e-2), (1e-3, 1e-5), (1e-4, 1e-8)):
        second = segment_at(120, 30 * tilt_rad, tilt_rad, 20)
        e = torch.cat([point_to_line(second[:, :2], first), point_to_line(second[:, 2:], first)], dim=1)
        f = torch.cat([point_to_line(first[:, :2], second), point_to_line(first[:, 2:], second)], dim=1)
        assert float(error_norm(line_to_line(first, second) - (e - f) / 2)) < tolerance


def test_line_to_line_of_degenerate_segments_is_the_distance_of_the_midpoints() -> None:
    point, segment = row(3.0, 4.0, 3.0, 4.0), row(-5.0, 0.0, 5.0, 0.0)
    for first, second in ((point, segment), (segment, point), (point, row(0.0, 0.0, 0.0, 0.0))):
        assert line_to_line(first, second).tolist() == [[5.0, 5.0]]


def test_parallel_is_the_sine_of_the_angle_positive_clockwise_on_the_screen() -> None:
    horizontal = row(0.0, 0.0, 2.0, 0.0)
    torch.testing.assert_close(parallel(horizontal, row(5.0, 5.0, 8.0, 9.0)), row(0.8))
    torch.testing.assert_close(parallel(horizontal, row(5.0, 5.0, 8.0, 1.0)), row(-0.8))
    assert parallel(horizontal, row(1.0, 9.0, 1.0, 99.0)).tolist() == [[1.0]]
    assert parallel(horizontal, row(7.0, 7.0, 7.0, 7.0)).tolist() == [[1.0]], "a point has no direction"


@few_examples
@given(segments, angle, coordinate, coordinate, half_length)
def test_parallel_is_the_sine_anywhere(s: Tensor, turn: float, x: float, y: float, half: float) -> None:
    heading = math.atan2(float(s[0, 3] - s[0, 1]), float(s[0, 2] - s[0, 0]))
    other = segment_at(x, y, heading + turn, half)
    assert float(parallel(s, other)) == pytest.approx(math.sin(turn), abs=1e-9)
    for flipped in (parallel(other, s), parallel(reversed_ends(s), other), parallel(s, reversed_ends(other))):
        torch.testing.assert_close(flipped, -parallel(s, other), rtol=0, atol=1e-12)


@few_examples
@given(segments, segments, points, points, angle, coordinate, coordinate)
def test_errors_do_not_depend_on_the_frame(
    first: Tensor, second: Tensor, x: Tensor, y: Tensor, turn: float, dx: float, dy: float
) -> None:
    def there(primitive: Tensor) -> Tensor:
        return moved(primitive, turn, dx, dy)

    norm_of_points = error_norm(point_to_point(x, y))
    torch.testing.assert_close(error_norm(point_to_point(there(x), there(y))), norm_of_points, rtol=0, atol=1e-6)
    torch.testing.assert_close(point_to_line(there(x), there(first)), point_to_line(x, first), rtol=0, atol=1e-6)
    torch.testing.assert_close(parallel(there(first), there(second)), parallel(first, second), rtol=0, atol=1e-9)
    norm_of_lines = error_norm(line_to_line(first, second))
    torch.testing.assert_close(error_norm(line_to_line(there(first), there(second))), norm_of_lines, rtol=0, atol=1e-5)


@pytest.mark.parametrize("function", SEGMENT_ERRORS)
def test_gradients_on_segments(function: Callable[[Tensor, Tensor], Tensor]) -> None:
    generator = torch.Generator().manual_seed(4)
    first, second = (
        (100 * torch.rand(6, 4, generator=generator, dtype=torch.float64)).requires_grad_() for _ in range(2)
    )
    assert torch.autograd.gradcheck(function, (first, second))


def test_gradients_on_points() -> None:
    x, y = row(1.0, 2.0).requires_grad_(), row(-4.0, 7.0).requires_grad_()
    segment = row(3.0, 3.0, 9.0, 4.0).requires_grad_()
    assert torch.autograd.gradcheck(point_to_point, (x, y))
    assert torch.autograd.gradcheck(point_to_line, (x, segment))
    assert torch.autograd.gradcheck(error_norm, (torch.cat([x, y]),))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("function", [*SEGMENT_ERRORS, lambda a, b: point_to_line(a[:, :2], b)])
def test_every_degenerate_or_satisfied_case_is_finite_in_value_and_gradient(
    function: Callable[[Tensor, Tensor], Tensor], dtype: torch.dtype
) -> None:
    cases = torch.tensor([[1, 1, 1, 1], [0, 0, 8, 6], [0, 0, 0, 0], [8, 6, 0, 0], [4, 3, 12, 9]], dtype=dtype)
    first = cases.repeat_interleave(len(cases), dim=0).requires_grad_()
    second = cases.repeat(len(cases), 1).requires_grad_()
    value = function(first, second)
    error_norm(value).sum().backward()
    assert value.dtype == dtype
    for tensor in (value, first.grad, second.grad):
        assert tensor is not None
        assert bool(tensor.isfinite().all())


@pytest.mark.parametrize("function", SEGMENT_ERRORS)
def test_batch_equals_loop(function: Callable[[Tensor, Tensor], Tensor]) -> None:
    generator = torch.Generator().manual_seed(0)
    first, second = (640 * torch.rand(40, 4, generator=generator) for _ in range(2))
    first[3, 2:] = first[3, :2]
    loop = torch.cat([function(first[i : i + 1], second[i : i + 1]) for i in range(40)])
    torch.testing.assert_close(function(first, second), loop)
    assert len(function(first[:0], second[:0])) == 0


def test_float32_keeps_a_small_distance_at_large_coordinates() -> None:
    # lᵀx with absolute coordinates would lose this quarter of a pixel to rounding
    segment = torch.tensor([[3800.0, 2100.0, 3900.0, 2100.0]])
    assert point_to_line(torch.tensor([[3840.0, 2100.25]]), segment).tolist() == [[0.25]]
