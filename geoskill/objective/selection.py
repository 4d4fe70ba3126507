"""The select-out function and how much of it falls beside the chosen alternatives.

``batch`` is the sorted frame number of each of the ``m`` instances; frames may have any number of them, also none.
Source: Jin et al., ICRA 2020, equation 5 and section III-C "Loss function"; METHOD, settled points 1 and 10.
"""

from jaxtyping import Float, Int
from torch import Tensor
from torch_geometric.utils import softmax, to_dense_batch


def select_out(scores: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int) -> Float[Tensor, " m"]:
    """Softmax g of the scores b over the instances of each frame (equation 5); g of a frame sums to 1.

    >>> import torch
    >>> select_out(torch.tensor([0.0, 0.0, 7.0]), torch.tensor([0, 0, 2]), num_frames=3)
    tensor([0.5000, 0.5000, 1.0000])
    """
    weights: Tensor = softmax(scores, batch, num_nodes=num_frames)
    return weights


def residual_sum_of_weights(
    select_out: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int, alternatives: int
) -> Float[Tensor, " frames"]:
    """RSW of each frame: 1 minus the sum of its p largest select-outs, in [0, 1].

    Summed over the remaining instances instead, which is the same because g sums to 1, but does not round a small
    RSW away. Frames with at most p instances, or none, have 0. Tied instances count one by one, which of them is
    among the p largest is arbitrary.

    Args:
        select_out: g, summing to 1 over each frame.
        batch: the frame of each instance, sorted.
        num_frames: frames, those without any instance included.
        alternatives: p, at least 1.

    >>> import torch
    >>> residual_sum_of_weights(torch.tensor([0.5, 0.125, 0.375, 1.0]), torch.tensor([0, 0, 0, 1]), 2, alternatives=2)
    tensor([0.1250, 0.0000])
    """
    by_frame, _ = to_dense_batch(select_out, batch, batch_size=num_frames)
    chosen = by_frame.topk(min(alternatives, by_frame.shape[1]), dim=1).indices
    residual: Tensor = by_frame.scatter(1, chosen, 0.0).sum(dim=1)
    return residual
