"""Control errors in space: independent references, zero at the constraint, symmetry, rank, and degenerate cases."""

from collections.abc import Callable, Sequence
from itertools import combinations, permutations

import numpy as np
import pytest
import torch
from scipy.optimize import minimize, minimize_scalar
from scipy.spatial.transform import Rotation
from torch import Tensor

from geoskill.geometry.space import (
    DEGENERATE_AREA_M2,
    coplanarity,
    direction_in_space,
    line_to_line_in_space,
    lines_coplanarity,
    middle_in_space,
    parallel_in_space,
    point_to_line_in_space,
    point_to_plane,
    point_to_point_in_space,
)

ERRORS: dict[str, tuple[Callable[..., Tensor], tuple[int, ...]]] = {
    "p2p3": (point_to_point_in_space, (3, 3)),
    "p2l3": (point_to_line_in_space, (3, 6)),
    "l2l3": (line_to_line_in_space, (6, 6)),
    "par3": (parallel_in_space, (6, 6)),
    "p2pl": (point_to_plane, (3, 4)),
    "copl": (lambda *points: coplanarity(torch.stack(points)), (3, 3, 3, 3)),
    "copl2": (lines_coplanarity, (6, 6)),
}
COUNT = 200


def random_nodes(widths: Sequence[int], count: int = COUNT) -> list[Tensor]:
    """Primitives within some decimeters, half a meter before the camera, in double precision."""
    random = np.random.default_rng(0)
    nodes = []
    for width in widths:
        rows = random.uniform(-0.3, 0.3, (count, width))
        if width == 4:
            rows[:, :3] /= np.linalg.norm(rows[:, :3], axis=1, keepdims=True)
        nodes.append(torch.from_numpy(rows))
    return nodes


def reversed_line(line: Tensor) -> Tensor:
    return torch.cat([line[:, 3:], line[:, :3]], dim=1)


def rotated(nodes: Sequence[Tensor], rotation: np.ndarray, shift: np.ndarray) -> list[Tensor]:
    """The same primitives after a motion of the camera."""
    turn, move = torch.from_numpy(rotation), torch.from_numpy(shift)
    result = []
    for rows in nodes:
        if rows.shape[1] == 4:
            normals = rows[:, :3] @ turn.T
            result.append(torch.cat([normals, rows[:, 3:] - (normals * move).sum(dim=1, keepdim=True)], dim=1))
        else:
            points = rows.reshape(len(rows), -1, 3) @ turn.T + move
            result.append(points.reshape(rows.shape))
    return result


@pytest.mark.parametrize("name", ERRORS)
def test_error_norm_is_that_of_the_world_not_of_the_camera(name: str) -> None:
    error, widths = ERRORS[name]
    nodes = random_nodes(widths)
    moved = rotated(nodes, Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix(), np.array([0.2, -0.1, 0.6]))
    torch.testing.assert_close(error(*moved).norm(dim=1), error(*nodes).norm(dim=1))


@pytest.mark.parametrize("name", ERRORS)
def test_gradient_is_that_of_finite_differences(name: str) -> None:
    error, widths = ERRORS[name]
    nodes = [rows.requires_grad_() for rows in random_nodes(widths, 4)]
    assert torch.autograd.gradcheck(error, nodes)


def test_point_to_line_is_the_way_to_the_nearest_point_of_the_carrier() -> None:
    points, lines = random_nodes((3, 6), 20)
    error = point_to_line_in_space(points, lines)
    for point, line, own in zip(points.numpy(), lines.numpy(), error.numpy(), strict=True):
        along = line[3:] - line[:3]
        nearest = minimize_scalar(lambda t: np.sum((line[:3] + t * along - point) ** 2), tol=1e-12).x  # noqa: B023
        np.testing.assert_allclose(own, point - line[:3] - nearest * along, atol=1e-7)
    torch.testing.assert_close(point_to_line_in_space(points, reversed_line(lines)), error)


def test_line_to_line_of_parallels_has_the_norm_of_their_distance() -> None:
    first, offsets = random_nodes((6, 3))
    direction = direction_in_space(first)
    slid = torch.cat([first[:, :3] - 0.3 * direction, first[:, 3:] + 0.8 * direction], dim=1)
    across = offsets - (offsets * direction).sum(dim=1, keepdim=True) * direction
    second = slid + across.repeat(1, 2)
    error = line_to_line_in_space(first, second)
    torch.testing.assert_close(error.norm(dim=1), across.norm(dim=1))
    torch.testing.assert_close(line_to_line_in_space(first, slid), torch.zeros_like(error), atol=1e-15, rtol=0)


def test_line_to_line_offsets_join_the_carriers_at_right_angles_to_the_axis() -> None:
    first, second = random_nodes((6, 6))
    error = (line_to_line_in_space(first, second) * 2**0.5).reshape(-1, 2, 3)
    a, b = direction_in_space(first), direction_in_space(second)
    b = torch.where((a * b).sum(dim=1, keepdim=True) < 0, -b, b)
    axis = torch.nn.functional.normalize(a + b, dim=1)
    assert (error * axis[:, None]).sum(dim=2).abs().max() < 1e-12
    # The halves differ by the lines' divergence over twice the mean half length.
    length = (first[:, 3:] - first[:, :3]).norm(dim=1) + (second[:, 3:] - second[:, :3]).norm(dim=1)
    divergence = (a - b) / (a * axis).sum(dim=1, keepdim=True) * length[:, None] / 2
    torch.testing.assert_close(error[:, 0] - error[:, 1], divergence)
    mean = middle_in_space(first) - middle_in_space(second)
    slope = ((a + b) / 2) / (a * axis).sum(dim=1, keepdim=True)
    torch.testing.assert_close(error.mean(dim=1), mean - (mean * axis).sum(dim=1, keepdim=True) * slope)


@pytest.mark.parametrize("name", ["l2l3", "par3", "copl2"])
def test_norm_of_line_errors_does_not_depend_on_order(name: str) -> None:
    error, _ = ERRORS[name]
    first, second = random_nodes((6, 6))
    norm = error(first, second).norm(dim=1)
    for nodes in ((second, first), (reversed_line(first), second), (first, reversed_line(second))):
        torch.testing.assert_close(error(*nodes).norm(dim=1), norm)


def test_signs_of_line_errors() -> None:
    first, second = random_nodes((6, 6))
    l2l3 = line_to_line_in_space(first, second)
    torch.testing.assert_close(
        line_to_line_in_space(second, first)[:, :3].norm(dim=1), l2l3_halves(l2l3, first, second)
    )
    torch.testing.assert_close(line_to_line_in_space(first, reversed_line(second)), l2l3)
    torch.testing.assert_close(line_to_line_in_space(reversed_line(first), second), reversed_line(l2l3))
    torch.testing.assert_close(parallel_in_space(second, first), -parallel_in_space(first, second))
    torch.testing.assert_close(lines_coplanarity(second, first), lines_coplanarity(first, second))
    torch.testing.assert_close(lines_coplanarity(reversed_line(first), second), -lines_coplanarity(first, second))


def l2l3_halves(error: Tensor, first: Tensor, second: Tensor) -> Tensor:
    """Norm of the first half after a swap: the axis then has the sense of the other line."""
    same = (direction_in_space(first) * direction_in_space(second)).sum(dim=1) >= 0
    return torch.where(same, error[:, :3].norm(dim=1), error[:, 3:].norm(dim=1))


def test_parallel_is_the_sine_of_the_angle() -> None:
    first, second = random_nodes((6, 6))
    a, b = (rows.numpy()[:, 3:] - rows.numpy()[:, :3] for rows in (first, second))
    cosine = (a * b).sum(axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    np.testing.assert_allclose(parallel_in_space(first, second).norm(dim=1), np.sqrt(1 - cosine**2))


def test_coplanarity_is_the_smallest_distance_of_a_point_to_the_plane_of_the_others() -> None:
    points = random_nodes((3,) * 4)
    expected = []
    for own in torch.stack(points, dim=1).numpy():
        distances = []
        for fourth in range(4):
            rest = np.delete(own, fourth, axis=0)
            normal = np.linalg.svd(rest - rest.mean(axis=0))[2][2]
            distances.append(abs(normal @ (own[fourth] - rest.mean(axis=0))))
        expected.append(min(distances))
    error = coplanarity(torch.stack(points))
    np.testing.assert_allclose(error.abs()[:, 0], expected, rtol=1e-9)
    for order in permutations(range(4)):
        inversions = sum(order[i] > order[j] for i, j in combinations(range(4), 2))
        torch.testing.assert_close(coplanarity(torch.stack([points[i] for i in order])), (-1) ** inversions * error)


def test_lines_coplanarity_is_the_distance_of_carriers_unless_nearly_parallel() -> None:
    first, second = random_nodes((6, 6), 20)
    sine = parallel_in_space(first, second).norm(dim=1)
    error = lines_coplanarity(first, second)[:, 0].abs()
    for a, b, own, own_sine in zip(first.numpy(), second.numpy(), error, sine, strict=True):

        def distance(t: np.ndarray, a: np.ndarray = a, b: np.ndarray = b) -> float:
            return float(np.linalg.norm(a[:3] + t[0] * (a[3:] - a[:3]) - b[:3] - t[1] * (b[3:] - b[:3])))

        nearest = minimize(distance, np.zeros(2), method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}).fun
        damping = float(own_sine / torch.hypot(own_sine, torch.sin(torch.deg2rad(torch.tensor(3.0)))))
        assert float(own) == pytest.approx(nearest * damping, abs=1e-6)
    parallel = first + torch.tensor([0.0, 0.05, 0.02] * 2)
    assert lines_coplanarity(first, parallel).abs().max() < 1e-12


RANKS = {"p2p3": 3, "p2l3": 2, "l2l3": 4, "par3": 2, "p2pl": 1, "copl": 1, "copl2": 1}


def satisfied(name: str) -> list[Tensor]:
    """Two primitives, or four points, that satisfy the constraint."""
    a, b, c = (torch.from_numpy(own)[None] for own in np.random.default_rng(1).uniform(-0.2, 0.2, (3, 3)))
    line = torch.cat([a, b], dim=1)
    match name:
        case "p2p3":
            return [a, a.clone()]
        case "p2l3":
            return [a + 1.7 * (b - a), line]
        case "l2l3":
            return [line, torch.cat([a + 2.0 * (b - a), a - 0.5 * (b - a)], dim=1)]
        case "par3":
            return [line, torch.cat([c, c + 0.4 * (b - a)], dim=1)]
        case "p2pl":
            normal = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a, dim=1), dim=1)
            return [0.3 * a + 0.9 * b - 0.2 * c, torch.cat([normal, -(normal * a).sum(dim=1, keepdim=True)], dim=1)]
        case "copl":
            return [a, b, c, 0.5 * a + 0.9 * b - 0.4 * c]
    return [line, torch.cat([0.5 * a + 0.9 * b - 0.4 * c, c], dim=1)]


@pytest.mark.parametrize("name", ERRORS)
def test_satisfied_constraint_is_zero_and_takes_its_rank_of_the_pose(name: str) -> None:
    error, _ = ERRORS[name]
    nodes = satisfied(name)
    assert error(*nodes).abs().max() < 1e-14
    carried = 2 if name == "copl" else 1

    def moved(twist: Tensor) -> Tensor:
        """Error when the first nodes move by a twist (v, w), to first order."""
        now = []
        for rows in nodes[:carried]:
            points = rows.reshape(-1, 3)
            shift = twist[:3] + torch.linalg.cross(twist[3:].expand_as(points), points)
            now.append((points + shift).reshape(rows.shape))
        return error(*now, *nodes[carried:])[0]

    jacobian = torch.autograd.functional.jacobian(moved, torch.zeros(6, dtype=torch.float64))
    values = torch.linalg.svdvals(jacobian)
    assert int((values > 1e-6 * values[0]).sum()) == RANKS[name]


def degenerate(name: str) -> list[tuple[list[Tensor], float]]:
    """Primitives without extent, and the norm of their error."""
    point, other = torch.tensor([[0.1, 0.2, 0.5]]), torch.tensor([[0.1, 0.2, 0.8]])
    dot, line = other.repeat(1, 2), torch.tensor([[0.1, 0.1, 0.5, 0.1, 0.3, 0.5]])
    match name:
        case "p2l3":
            return [([point, dot], 0.3)]
        case "l2l3" | "copl2":
            return [([line, dot], 0.3), ([dot, line], 0.3), ([dot, point.repeat(1, 2)], 0.3)]
        case "par3":
            return [([line, dot], 1.0), ([dot, dot], 1.0)]
        case "copl":
            along = [point + step * torch.tensor([[0.0, 0.01, 0.0]]) for step in range(4)]
            return [(along, 0.03), ([point] * 4, 0.0), ([point, other, point, other], 0.3)]
    return []


@pytest.mark.parametrize("name", ["p2l3", "l2l3", "par3", "copl", "copl2"])
def test_degenerate_primitives_have_a_finite_error_that_never_is_satisfied(name: str) -> None:
    error, _ = ERRORS[name]
    for nodes, norm in degenerate(name):
        nodes = [rows.clone().requires_grad_() for rows in nodes]
        value = error(*nodes)
        assert float(value.detach().norm()) == pytest.approx(norm, abs=1e-6)
        gradients = torch.autograd.grad(value.sum(), nodes, allow_unused=True)
        assert all(own is None or own.isfinite().all() for own in gradients)


def test_coplanarity_is_degenerate_below_an_area_only() -> None:
    for area, expected in ((0.9 * DEGENERATE_AREA_M2, 0.2), (1.1 * DEGENERATE_AREA_M2, 0.0)):
        height = 2 * area / 0.2
        points = [[0, 0, 1.0], [0.2, 0, 1], [0.1, height, 1], [0.05, 0, 1]]
        error = coplanarity(torch.tensor(points, dtype=torch.float64)[:, None])
        assert float(error) == pytest.approx(expected, abs=1e-9)
