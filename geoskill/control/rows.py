"""Rows of the control law: the error of each association, and its derivative with respect to the action.

By the chain rule: for nodes y that are carried, whose pixels move with J(y), and others at rest::

    dE / dq = sum over carried nodes of dE / dy J(y),

where dE / dy is the gradient of the kernel's own control error. So every kernel can drive the loop. A segment is its
two end points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Float64

from geoskill.control.image_motion import ImageMotion
from geoskill.kernels.kernel import Kernel


@final
@dataclass(frozen=True, eq=False)
class Constraint:
    """One association in one picture, as the control law takes it.

    Attributes:
        kernel: gives the error.
        nodes: geometry of each node in pixels, a point or a segment.
        carried: which nodes move with the actor.
        confidence: probability that it is right, in [0, 1].
        target: error that is to be reached; None for zero.
        camera: number of the picture.
        member: name of the member of the skill that selected it.
        rank: among those of its member in the frame, from 1.

    Raises:
        ValueError: when there are not as many nodes as the kernel has.
    """

    kernel: Kernel
    nodes: tuple[Float64[np.ndarray, " _"], ...]
    carried: tuple[bool, ...]
    confidence: float = 1.0
    target: tuple[float, ...] | None = None
    camera: int = 0
    member: str = ""
    rank: int = 1

    def __post_init__(self) -> None:
        if not len(self.nodes) == len(self.carried) == len(self.kernel.roles):
            raise ValueError(
                f"{len(self.nodes)} nodes and {len(self.carried)} flags; expected {len(self.kernel.roles)} of each, as"
                f" {self.kernel.name} has"
            )

    @property
    def slot(self) -> tuple[str, int, int]:
        """What stays the same when another association is selected: member, rank and camera."""
        return self.member, self.rank, self.camera


@final
@dataclass(frozen=True, eq=False)
class Row:
    """Error and Jacobian of one constraint.

    Attributes:
        constraint: it is of.
        error: pixels, or in units of the kernel's resolution.
        jacobian: derivative of the error with respect to the action.
        weight: from elsewhere than the residuals: of its phase.
    """

    constraint: Constraint
    error: Float64[np.ndarray, " d"]
    jacobian: Float64[np.ndarray, "d n"]
    weight: float = 1.0


def rows_of(constraints: Sequence[Constraint], motions: Sequence[ImageMotion]) -> list[Row]:
    """Return the rows of constraints, in their order.

    Args:
        constraints: associations with at least one carried node and one at rest.
        motions: the field of each camera.
    """
    groups: dict[tuple[str, int], list[int]] = {}
    for index, constraint in enumerate(constraints):
        groups.setdefault((constraint.kernel.name, constraint.camera), []).append(index)
    rows: dict[int, Row] = {}
    for (_, camera), indices in groups.items():
        group = [constraints[index] for index in indices]
        errors, jacobians = _errors_and_jacobians(group, motions[camera])
        for index, constraint, error, jacobian in zip(indices, group, errors, jacobians, strict=True):
            goal = np.zeros(len(error)) if constraint.target is None else np.array(constraint.target, np.float64)
            unit = unit_of(constraint.kernel)
            rows[index] = Row(constraint, (error - goal) / unit, jacobian / unit)
    return [rows[index] for index in range(len(constraints))]


def unit_of(kernel: Kernel) -> float:
    """Return what an error is divided by so that 1 is about what detection resolves: 1 for pixels."""
    return 1.0 if kernel.unit == "px" else kernel.resolution


def error_gradients(
    kernel: Kernel, nodes: Sequence[Float64[np.ndarray, "m _"]]
) -> tuple[Float64[np.ndarray, "m d"], list[Float64[np.ndarray, "m d _"]]]:
    """Return the errors of instances of one kernel, and their gradients with respect to each node's coordinates.

    Args:
        kernel: of all of them.
        nodes: their geometry by role, pixels.
    """
    with torch.inference_mode(False), torch.enable_grad():
        variables = [torch.tensor(geometry, dtype=torch.float64, requires_grad=True) for geometry in nodes]
        errors = kernel.control_error(variables)
        gradients = [
            torch.autograd.grad(errors[:, row].sum(), variables, retain_graph=True, allow_unused=True)
            for row in range(errors.shape[1])
        ]
    stacked = []
    for node, variable in enumerate(variables):
        own = [torch.zeros_like(variable) if row[node] is None else row[node] for row in gradients]
        stacked.append(np.asarray(torch.stack(own, dim=1).numpy()))
    return np.asarray(errors.detach().numpy()), stacked


def _errors_and_jacobians(
    group: Sequence[Constraint], motion: ImageMotion
) -> tuple[Float64[np.ndarray, "m d"], Float64[np.ndarray, "m d n"]]:
    """Return errors and Jacobians of constraints of one kernel in one picture."""
    nodes = [np.stack([own.nodes[node] for own in group]) for node in range(len(group[0].nodes))]
    errors, gradients = error_gradients(group[0].kernel, nodes)
    # One call of the field for the points of all nodes, since a call costs more than a point.
    points = np.concatenate([geometry.reshape(-1, 2) for geometry in nodes])
    moved = motion.jacobian(points)
    jacobians = np.zeros((len(group), errors.shape[1], moved.shape[2]))
    start = 0
    for node, gradient in enumerate(gradients):
        count = nodes[node].shape[1] // 2
        own = moved[start : start + len(group) * count].reshape(len(group), 2 * count, -1)
        carried = np.array([constraint.carried[node] for constraint in group])
        jacobians += np.einsum("mdc,mcn->mdn", gradient * carried[:, None, None], own)
        start += len(group) * count
    return errors, jacobians
