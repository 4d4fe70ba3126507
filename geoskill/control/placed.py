"""Constraints that hold, and their rows: how each error changes with the twist of the carried thing.

In pictures by the chain rule from the kernel's own error; in space, to first order, as the constraint is meant.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.camera_motion import cross_matrices, point_jacobians
from geoskill.control.rows import error_gradients, unit_of
from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.uncertainty import DETECTION_STD_PX
from geoskill.kernels.kernel import Kernel

SCALE: Final = np.array([0.01] * 3 + [np.radians(10.0)] * 3)
"""Columns are per centimeter and per ten degrees, so that singular values can be compared."""
SPACE_STD_M: Final = 0.002
"""Noise of a point measured with depth at half a meter."""
COPLANAR: Final = "copl"

Points3 = Float64[np.ndarray, "_ 3"]


@final
@dataclass(frozen=True, eq=False)
class Placed:
    """A constraint with its nodes in space.

    Attributes:
        kernel: gives the error in pictures; None for one that says nothing in a picture.
        name: of the kernel.
        nodes: a point, or the two ends of a segment, of each node, meters.
        carried: which nodes move with the actor.
    """

    kernel: Kernel | None
    name: str
    nodes: tuple[Points3, ...]
    carried: tuple[bool, ...]

    @property
    def moving(self) -> list[int]:
        """Numbers of the nodes that move with the actor."""
        return [node for node, carried in enumerate(self.carried) if carried]


def picture_rows(
    placed: Sequence[Placed], camera: PinholeCamera, grip: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "r 6"]:
    """Return the rows of constraints in a picture with respect to the twist, over noise and per unit of scale."""
    rows = [np.zeros((0, 6))]
    for own in placed:
        if own.kernel is None:
            continue
        pixels = [project(camera, node)[0].reshape(1, -1) for node in own.nodes]
        _, gradients = error_gradients(own.kernel, pixels)
        moved = np.zeros((own.kernel.error_dim, 6))
        for node in own.moving:
            jacobian = point_jacobians(camera, own.nodes[node], grip).reshape(-1, 6)
            moved += gradients[node][0] @ jacobian
        noise = DETECTION_STD_PX if own.kernel.unit == "px" else unit_of(own.kernel)
        rows.append(moved / noise * SCALE)
    return np.concatenate(rows)


def space_rows(placed: Sequence[Placed], grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "r 6"] | None:
    """Return the rows of constraints in space, to first order at a goal; None for a kernel without meaning in space."""
    rows = [np.zeros((0, 6))]
    for own in placed:
        if own.name not in SPACE_ROWS:
            return None
        rows.append(SPACE_ROWS[own.name](own, grip) / SPACE_STD_M * SCALE)
    return np.concatenate(rows)


def _across(direction: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3 3"]:
    unit = direction / np.linalg.norm(direction)
    return np.asarray(np.eye(3) - np.outer(unit, unit))


def _moves(point: Float64[np.ndarray, "3"], grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "3 6"]:
    """Return the velocity of a point of the carried thing as a function of the twist."""
    return np.concatenate([np.eye(3), -cross_matrices((point - grip)[None])[0]], axis=1)


def _line_of(own: Placed) -> Points3:
    return next(node for node in own.nodes if len(node) == 2)


def _point_rows(own: Placed, grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 6"]:
    return _moves(own.nodes[0][0], grip)


def _point_on_line_rows(own: Placed, grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 6"]:
    # Whichever of the two moves, what counts is their relative motion at the point.
    point = next(node for node in own.nodes if len(node) == 1)[0]
    line = _line_of(own)
    return np.asarray(_across(line[1] - line[0]) @ _moves(point, grip))


def _collinear_rows(own: Placed, grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 6"]:
    line = own.nodes[own.moving[0]]
    across = _across(line[1] - line[0])
    return np.concatenate([across @ _moves(end, grip) for end in line])


def _parallel_rows(own: Placed, grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 6"]:
    line = own.nodes[own.moving[0]]
    length = float(np.linalg.norm(line[1] - line[0]))
    return np.concatenate([np.zeros((3, 3)), _across(line[1] - line[0]) * length], axis=1)


def _coplanar_rows(own: Placed, grip: Float64[np.ndarray, "3"]) -> Float64[np.ndarray, "_ 6"]:
    """Return the row of four points in one plane: each moves out of it by its height over the others' triangle."""
    points = np.concatenate(own.nodes)
    row = np.zeros((1, 6))
    normal = np.cross(points[1] - points[0], points[2] - points[0])
    normal = normal / np.linalg.norm(normal)
    for node in own.moving:
        others = [points[index] for index in range(len(points)) if index != node]
        area = np.cross(others[1] - others[0], others[2] - others[0]) @ normal
        row += (-1) ** node * area * (normal @ _moves(points[node], grip))[None]
    return row / max(float(np.abs(row[0, :3]).max()), 1e-12)


SPACE_ROWS: Final = {
    "p2p": _point_rows,
    "p2l": _point_on_line_rows,
    "l2l": _collinear_rows,
    "par": _parallel_rows,
    COPLANAR: _coplanar_rows,
}
"""Rows in space by the kernel's name."""
