"""The reward of a transition between two frames: positive when the selected control error decreases.

``batch`` is the sorted frame number of each of the ``m`` instances; a frame without any instance yields 0.
Source: Jin et al., ICRA 2020, equations 6 and 7; METHOD, settled points 2, 11 and 12.
"""

from typing import Literal, get_args

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch_geometric.utils import scatter

from geoskill.errors import InputError
from geoskill.geometry.control_errors import error_norm

ErrorReduction = Literal["norm", "vector"]


def reward(change: Float[Tensor, "*batch"], beta: float) -> Float[Tensor, "*batch"]:
    """r = -tanh(beta · change / 2), in [-1, 1]: equation 7, 2 / (1 + exp(beta · change)) - 1, without its overflow.

    Args:
        change: of the control error's norm, later minus earlier, in the error's unit.
        beta: inverse of that unit, positive (:func:`beta_from_changes`).

    An error that falls by 2 px at beta = 1 / px earns tanh(1):

    >>> reward(torch.tensor([-2.0, 0.0, 1e6]), beta=1.0)
    tensor([ 0.7616, -0.0000, -1.0000])
    """
    return -torch.tanh(beta / 2 * change)


def tracked_change(
    select_out: Float[Tensor, " m"], change: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int
) -> Float[Tensor, " frames"]:
    """sum_i g_i delta_i of each frame, where delta_i is the change of its own tracked instance i (METHOD, "tracked").

    >>> tracked_change(torch.tensor([0.25, 0.75]), torch.tensor([-8.0, 4.0]), torch.tensor([0, 0]), num_frames=2)
    tensor([1., 0.])
    """
    return _sum_by_frame(select_out * change, batch, num_frames)


def overall_error(
    select_out: Float[Tensor, " m"],
    errors: Float[Tensor, "m d"],
    batch: Int[Tensor, " m"],
    num_frames: int,
    reduction: ErrorReduction,
) -> Float[Tensor, " frames"]:
    """Magnitude of each frame's overall control error Ec (equation 6), in the error's unit.

    Args:
        reduction: ``norm`` for sum_i g_i norm(E_i), which instances without a sign need (METHOD #2); ``vector`` for
            the literal norm(sum_i g_i E_i), whose gradient is zero where the sum vanishes.

    Raises:
        InputError: the reduction is neither.

    >>> halves, opposite = torch.tensor([0.5, 0.5]), torch.tensor([[3.0, 4.0], [-3.0, -4.0]])
    >>> overall_error(halves, opposite, torch.tensor([0, 0]), 1, "norm")
    tensor([5.])
    >>> overall_error(halves, opposite, torch.tensor([0, 0]), 1, "vector")
    tensor([0.])
    """
    if reduction == "norm":
        return _sum_by_frame(select_out * error_norm(errors), batch, num_frames)
    if reduction == "vector":
        return error_norm(_sum_by_frame(select_out[:, None] * errors, batch, num_frames))
    raise InputError(f"error_reduction is {reduction!r}; expected one of {', '.join(get_args(ErrorReduction))}")


def beta_from_changes(changes: Float[Tensor, " m"], scale: float = 1.5, minimum_change_px: float = 1.0) -> float:
    """beta = scale / median(abs(change)) over the instances that move: the median mover earns tanh(scale / 2).

    Args:
        changes: of all instances of one demonstration, tracked over one frame gap.
        scale: the constant c of METHOD #12.
        minimum_change_px: an instance moves when its absolute change is above this, in the unit of the error.

    Returns:
        beta in the inverse of the error's unit; the median of an even number is the mean of the middle two.

    Raises:
        InputError: nothing moves.

    >>> beta_from_changes(torch.tensor([0.5, -2.0, 4.0, 0.0]))
    0.5
    """
    sizes = changes.detach().abs()
    moving = sizes[sizes > minimum_change_px].sort().values
    count = len(moving)
    if count == 0:
        largest = float(sizes.max()) if len(sizes) else 0.0
        raise InputError(
            f"nothing moves in the demonstration: the control errors of its {len(sizes)} tracked instances change by "
            f"at most {largest:.3g}; expected some to change by more than {minimum_change_px:g}"
        )
    median = (moving[(count - 1) // 2] + moving[count // 2]) / 2
    return scale / float(median)


def _sum_by_frame(values: Tensor, batch: Tensor, num_frames: int) -> Tensor:
    total: Tensor = scatter(values, batch, dim=0, dim_size=num_frames, reduce="sum")
    return total
