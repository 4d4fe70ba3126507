"""Index tensors of all pairs of features."""

import torch
from jaxtyping import Int64
from torch import Tensor


def unordered_pairs(count: int) -> Int64[Tensor, "2 m"]:
    """Return all pairs i < j of ``count`` features of one type; m = count * (count - 1) / 2.

    >>> unordered_pairs(3).tolist()
    [[0, 0, 1], [1, 2, 2]]
    """
    return torch.triu_indices(count, count, offset=1)


def all_pairs(first: int, second: int) -> Int64[Tensor, "2 m"]:
    """Return every feature of one type paired with every feature of another; m = first * second.

    >>> all_pairs(2, 2).tolist()
    [[0, 0, 1, 1], [0, 1, 0, 1]]
    """
    return torch.cartesian_prod(torch.arange(first), torch.arange(second)).reshape(-1, 2).T.contiguous()
