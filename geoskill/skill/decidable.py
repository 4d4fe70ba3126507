"""What the selected associations of a frame determine, with a nominal camera where none is known.

Pictures show no depth. The resting features are taken to lie on a table, seen by a camera with a view of 40 degrees,
0.7 m away and 50 degrees down; the rank hardly depends on that. The carried nodes are put to where the errors are zero.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float64

from geoskill.control.decidability import Decidability, decidability
from geoskill.control.placed import Placed
from geoskill.control.rows import error_gradients
from geoskill.geometry.camera import PinholeCamera, focal_length_px, look_at
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Association, InferenceResult, NodeRole

VIEW_RAD: Final = math.radians(40)
DISTANCE_M: Final = 0.7
DOWN_RAD: Final = math.radians(50)
ASIDE_RAD: Final = math.radians(60)
"""Turn of the second camera about the vertical."""
MIN_CONFIDENCE: Final = 0.2
ROUNDS: Final = 30

Nodes = list[Float64[np.ndarray, " _"]]


def nominal_cameras(width: int, height: int) -> tuple[PinholeCamera, PinholeCamera]:
    """Return a camera that looks at a table, and a second one that looks at the same place from the side."""
    cameras = []
    for aside in (0.0, ASIDE_RAD):
        flat = DISTANCE_M * math.cos(DOWN_RAD)
        position = np.array([flat * math.sin(aside), -flat * math.cos(aside), DISTANCE_M * math.sin(DOWN_RAD)])
        pose = look_at(position, np.zeros(3))
        cameras.append(PinholeCamera(width, height, focal_length_px(height, VIEW_RAD), pose))
    return cameras[0], cameras[1]


def decidability_of(
    kernels: Mapping[str, Kernel], result: InferenceResult, size: tuple[int, int], max_rank: int | None = None
) -> Decidability | None:
    """Return what the listed associations of a frame determine; None where there is none that is confident.

    Args:
        kernels: of the members, by their names.
        result: of the frame.
        size: width and height of the picture, pixels.
        max_rank: of the associations that count; None for all that are listed.
    """
    cameras = nominal_cameras(*size)
    placed = []
    for own in result.associations:
        in_picture = not kernels[own.member].in_space
        if in_picture and own.confidence >= MIN_CONFIDENCE and (max_rank is None or own.rank <= max_rank):
            nodes, carried = satisfied(kernels[own.member], own)
            in_space = [_on_table(cameras[0], node.reshape(-1, 2)) for node in nodes]
            if all(np.isfinite(points).all() for points in in_space):
                placed.append(Placed(kernels[own.member], own.kernel, tuple(in_space), carried))
    return decidability(placed, cameras) if placed else None


def satisfied(kernel: Kernel, association: Association) -> tuple[Nodes, tuple[bool, ...]]:
    """Return the nodes with the carried ones moved to where the error is zero, and which ones those are.

    Gauss and Newton's method, with the shortest step: the carried nodes go no farther than they have to.
    """
    roles = [node.role for node in association.nodes]
    carried = tuple(index == 0 if None in roles else role is NodeRole.MOVING for index, role in enumerate(roles))
    nodes: Nodes = [np.array(node.coordinates, np.float64) for node in association.nodes]
    for _ in range(ROUNDS):
        errors, gradients = error_gradients(kernel, [node[None] for node in nodes])
        moving = [index for index, moves in enumerate(carried) if moves]
        slope = np.concatenate([gradients[index][0] for index in moving], axis=1)
        step = -np.linalg.lstsq(slope, errors[0], rcond=1e-6)[0]
        for index in moving:
            count = len(nodes[index])
            nodes[index], step = nodes[index] + step[:count], step[count:]
        if float(np.linalg.norm(errors)) < 1e-6 * kernel.resolution:
            break
    return nodes, carried


def _on_table(camera: PinholeCamera, pixels: Float64[np.ndarray, "p 2"]) -> Float64[np.ndarray, "p 3"]:
    """Return the points of the table that pixels show; NaN above the horizon."""
    rays = np.column_stack([(pixels - camera.center_px) / camera.focal_px, np.ones(len(pixels))])
    rays = rays @ camera.pose[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        depths = np.where(rays[:, 2] < -1e-3, -camera.pose[2, 3] / rays[:, 2], np.nan)
    return np.asarray(camera.pose[:3, 3] + depths[:, None] * rays)
