"""The select-out function, and the weight that it leaves outside the chosen instances.

``batch`` is the sorted frame number of each of the ``m`` instances; frames may have any number of instances, also none.
Source: Jin et al., ICRA 2020, equation 5 and section III-C "Loss function"; design choices 1 and 10
(docs/design-choices.md).
"""

from jaxtyping import Float, Int
from torch import Tensor
from torch_geometric.utils import softmax, to_dense_batch


def select_out(scores: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int) -> Float[Tensor, " m"]:
    """Return the softmax g of the scores b over the instances of each frame (equation 5); g of a frame sums to 1.

    >>> import torch
    >>> select_out(torch.tensor([0.0, 0.0, 7.0]), torch.tensor([0, 0, 2]), num_frames=3)
    tensor([0.5000, 0.5000, 1.0000])
    """
    weights: Tensor = softmax(scores, batch, num_nodes=num_frames)
    return weights


def residual_sum_of_weights(
    select_out: Float[Tensor, " m"], batch: Int[Tensor, " m"], num_frames: int, top_k: int
) -> Float[Tensor, " frames"]:
    """Return the RSW of each frame: 1 minus the sum of its p largest select-outs, in [0, 1].

    Computed as the sum over the remaining instances, which is the same because g sums to 1, but does not round a small
    RSW away. Frames with at most p instances, or none, have 0. Tied instances count one by one; which of them are among
    the p largest is arbitrary.

    Args:
        select_out: g, summing to 1 over each frame.
        batch: the frame of each instance, sorted.
        num_frames: number of frames, those without any instance included.
        top_k: p, at least 1.

    >>> import torch
    >>> residual_sum_of_weights(torch.tensor([0.5, 0.125, 0.375, 1.0]), torch.tensor([0, 0, 0, 1]), 2, top_k=2)
    tensor([0.1250, 0.0000])
    """
    by_frame, _ = to_dense_batch(select_out, batch, batch_size=num_frames)
    chosen = by_frame.topk(min(top_k, by_frame.shape[1]), dim=1).indices
    residual: Tensor = by_frame.scatter(1, chosen, 0.0).sum(dim=1)
    return residual
