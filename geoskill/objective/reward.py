"""The reward of a transition between two frames: positive when the selected control error decreases.

``batch`` is the sorted frame number of each of the ``m`` instances; a frame without any instance yields 0.
Source: Jin et al., ICRA 2020, equations 6 and 7; design choices 2, 11 and 12 (docs/design-choices.md).
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch_geometric.utils import scatter

from geoskill.errors import InputError
from geoskill.geometry.control_errors import error_norm


def reward(
    change: Float[Tensor, "*batch"], beta: float | Float[Tensor, ""] | Float[Tensor, "*batch"]
) -> Float[Tensor, "*batch"]:
    """Return r = 2 / (1 + exp(beta · change)) - 1 in [-1, 1] (equation 7).

    Computed as -tanh(beta · change / 2), which cannot overflow (design choice 11).

    Args:
        change: of the control error, later minus earlier; negative for an approach (:func:`error_change`).
        beta: in the inverse of the change's unit, positive (:func:`beta_from_changes`).

    An error that falls by 2 px at beta = 1 / px earns tanh(1):

    >>> reward(torch.tensor([-2.0, 0.0, 1e6]), beta=1.0)
    tensor([ 0.7616, -0.0000, -1.0000])
    """
    return -torch.tanh(beta / 2 * change)


def tracked_change(
    select_out: Float[Tensor, " m"], change: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int
) -> Float[Tensor, " frames"]:
    """Return sum_i g_i delta_i of each frame, where delta_i is the change of its own tracked instance i.

    See docs/method.md, Reward, "tracked".

    >>> tracked_change(torch.tensor([0.25, 0.75]), torch.tensor([-8.0, 4.0]), torch.tensor([0, 0]), num_frames=2)
    tensor([1., 0.])
    """
    return _sum_by_frame(select_out * change, batch, num_frames)


def overall_error(
    select_out: Float[Tensor, " m"],
    errors: Float[Tensor, "m d"],
    batch: Int[Tensor, " m"],
    num_frames: int,
    reduction: str,
) -> Float[Tensor, " frames"]:
    """Return the magnitude of each frame's overall control error Ec (equation 6), in the error's unit.

    Args:
        select_out: g of every instance.
        errors: control error E of every instance.
        batch: frame of every instance, sorted.
        num_frames: number of frames, those without any instance included.
        reduction: ``norm`` for sum_i g_i norm(E_i), which instances without a sign need (design choice 2);
            ``vector`` for the paper's literal norm(sum_i g_i E_i), whose gradient is zero where the sum vanishes.

    Raises:
        InputError: when the reduction is neither.

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
    raise InputError(f"reduction={reduction}: expected one of norm, vector")


def error_change(
    before: Float[Tensor, " m"], after: Float[Tensor, " m"], change: str, resolution: float
) -> Float[Tensor, " m"]:
    """Return by how much the error norm of each instance changes between two frames; exchanging them flips the sign.

    Args:
        before: norm of the control error at the earlier frame.
        after: norm at the later frame.
        change: ``absolute`` is after - before, as in the paper (equation 7). ``relative`` divides that by the sum of
            both norms: an object that reaches its target halves its distance again and again, while the hand that
            carries it, or a mark that it passes, does not, although both come as many pixels closer.
        resolution: error within what detection can resolve, in the error's unit. It damps the relative change of
            instances that are together all the time.

    Raises:
        InputError: when the change is neither.

    >>> before, after = torch.tensor([96.0, 96.0]), torch.tensor([0.0, 48.0])
    >>> error_change(before, after, "relative", resolution=1.0)
    tensor([-0.9600, -0.3243])
    """
    if change == "absolute":
        return after - before
    if change == "relative":
        # The features of an instance at rest are each off by about the resolution, at both ends of the span.
        return (after - before) / (after + before + 4.0 * resolution)
    raise InputError(f"change={change}: expected one of relative, absolute")


def beta_from_changes(
    changes: Float[Tensor, " m"], moving: Bool[Tensor, " m"], scale: float = 1.5
) -> Float[Tensor, ""]:
    """Return scale / median(abs(change)) over the moving instances: a median one that approaches earns tanh(scale / 2).

    Args:
        changes: of all instances of a demonstration, tracked over one span of time (:func:`error_change`).
        moving: whether each of them changes by more than detection can resolve.
        scale: the constant c of design choice 12.

    Returns:
        Beta in the inverse of the changes' unit; 0 when nothing moves, so that such a span earns no reward. The median
        of an even number of values is the mean of the middle two.

    >>> beta_from_changes(torch.tensor([0.5, -2.0, 4.0, 0.0]), torch.tensor([False, True, True, False]))
    tensor(0.5000)
    """
    sizes = changes.detach().abs()[moving].sort().values
    count = len(sizes)
    if count == 0:
        return torch.zeros((), dtype=changes.dtype)
    return scale / ((sizes[(count - 1) // 2] + sizes[count // 2]) / 2)


def _sum_by_frame(values: Tensor, batch: Tensor, num_frames: int) -> Tensor:
    total: Tensor = scatter(values, batch, dim=0, dim_size=num_frames, reduce="sum")
    return total
