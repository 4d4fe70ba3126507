"""Rows: errors and Jacobians of every kernel against finite differences through the whole projection."""

import numpy as np
import pytest
import torch

from geoskill.control.action import action_space
from geoskill.control.camera_motion import CameraMotion
from geoskill.control.points_plant import carried_out, points_cameras
from geoskill.control.rows import Constraint, error_gradients, rows_of
from geoskill.geometry.camera import project
from geoskill.geometry.poses import transform
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from tests.control.small_loops import KERNELS, L2L, P2P, PAR, pair

SPACE = action_space("xyzabc")


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
def test_gradients_are_those_of_finite_differences(kernel: Kernel) -> None:
    rng = np.random.default_rng(0)
    nodes = [rng.uniform(0, 400, (50, role.geometry_dim)) for role in kernel.roles]
    errors, gradients = error_gradients(kernel, nodes)
    np.testing.assert_allclose(errors, kernel.control_error([torch.tensor(own) for own in nodes]).numpy())
    size = 1e-4
    for node, gradient in enumerate(gradients):
        for column in range(nodes[node].shape[1]):
            moved = []
            for sign in (1.0, -1.0):
                own = [torch.tensor(geometry.copy()) for geometry in nodes]
                own[node][:, column] += sign * size
                moved.append(kernel.control_error(own).numpy())
            numeric = (moved[0] - moved[1]) / (2 * size)
            np.testing.assert_allclose(gradient[:, :, column], numeric, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
def test_jacobians_are_those_of_moving_the_thing(kernel: Kernel) -> None:
    """Moving the carried points in space by a small action changes the error by J times the action."""
    rng, camera = np.random.default_rng(1), points_cameras(1)[0]
    grip = np.array([0.03, 0.05, 0.1])
    count = 2 if NodeType.LINE in kernel.roles else 1
    marks = rng.uniform(-0.05, 0.05, (count, 3)) + np.array([0.0, 0.0, 0.05])
    resting = rng.uniform(100, 400, 4)[: kernel.roles[1].geometry_dim]

    def error(action: np.ndarray) -> np.ndarray:
        body, _ = carried_out(np.eye(4), grip, SPACE.basis @ action)
        pixels = project(camera, transform(body, marks))[0].reshape(-1)[: kernel.roles[0].geometry_dim]
        return kernel.control_error([torch.tensor(pixels[None]), torch.tensor(resting[None])])[0].numpy()

    pixels, depths = project(camera, marks)
    nodes = (pixels.reshape(-1)[: kernel.roles[0].geometry_dim], resting)
    # Every pixel asked for is one of the marks, in their order.
    motion = CameraMotion(camera, SPACE, grip, lambda own: np.resize(depths, len(own)))
    constraint = Constraint(kernel, nodes, (True, False))
    [row] = rows_of([constraint], [motion])
    unit = 1.0 if kernel.unit == "px" else kernel.resolution
    np.testing.assert_allclose(row.error * unit, error(np.zeros(6)), atol=1e-9)
    for column in range(6):
        step = np.zeros(6)
        step[column] = 1e-6
        numeric = (error(step) - error(-step)) / 2e-6
        np.testing.assert_allclose(row.jacobian[:, column] * unit, numeric, rtol=1e-4, atol=1e-3)


def test_two_nodes_the_other_way_round_drive_the_same_way() -> None:
    """The pair (a, b) with b carried asks for the same motion as (b, a) with b first."""
    camera = points_cameras(1)[0]
    motion = CameraMotion(camera, SPACE, np.zeros(3), lambda own: np.full(len(own), 0.7))
    nodes = (np.array([100.0, 120.0]), np.array([300.0, 250.0]))
    [first] = rows_of([Constraint(P2P, nodes, (False, True))], [motion])
    [second] = rows_of([Constraint(P2P, nodes[::-1], (True, False))], [motion])
    np.testing.assert_allclose(first.error, -second.error)
    np.testing.assert_allclose(first.jacobian, -second.jacobian)


def test_target_and_unit() -> None:
    camera = points_cameras(1)[0]
    motion = CameraMotion(camera, SPACE, np.zeros(3), lambda own: np.full(len(own), 0.7))
    lines = (np.array([0.0, 0.0, 10.0, 0.0]), np.array([5.0, 5.0, 5.0, 9.0]))
    rows = rows_of([pair((10.0, 20.0), (4.0, 4.0), target=(1.0, 2.0)), Constraint(PAR, lines, (True, False))], [motion])
    np.testing.assert_allclose(rows[0].error, [5.0, 14.0])
    np.testing.assert_allclose(rows[1].error, [1 / 0.02])


def test_number_of_nodes_is_checked() -> None:
    with pytest.raises(ValueError, match="1 nodes and 2 flags; expected 2 of each, as l2l has"):
        Constraint(L2L, (np.zeros(4),), (True, False))
