"""Scoring instances a chunk at a time: in the processor's cache, and within the memory that there is.

What is computed of an instance is large, what comes out is one number. A chunk whose intermediate results stay in the
cache is faster than all instances at once. And where autograd cannot keep all of them until the backward pass, it keeps
none: each chunk is computed again when its gradient is due ("Training deep nets with sublinear memory cost", Chen et
al., 2016), which takes about half as long again, and gives the same gradient.
"""

from collections.abc import Callable

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.utils.checkpoint import checkpoint

MIB = 1 << 20
# Of intermediate results; about the second and third level cache of a core.
CACHE_BYTES = 8 * MIB
# Chunks of a GPU, whose cores want all work at once.
GPU_CHUNK_BYTES = 512 * MIB

Score = Callable[[Int64[Tensor, "k c"]], Float[Tensor, " c"]]


def in_chunks(
    score: Score, instance_index: Int64[Tensor, "k m"], *, working_bytes: int, saved_bytes: float, memory_bytes: float
) -> Float[Tensor, " m"]:
    """The scores of all instances.

    Args:
        score: of some instances.
        instance_index: of all of them.
        working_bytes: of one instance's largest intermediate result.
        saved_bytes: that autograd keeps of one instance.
        memory_bytes: that it may keep of all of them.
    """
    count = instance_index.shape[1]
    largest = GPU_CHUNK_BYTES if instance_index.is_cuda else CACHE_BYTES
    chunk = max(1, largest // working_bytes)
    again = torch.is_grad_enabled() and count * saved_bytes > memory_bytes
    if again:
        chunk = max(1, min(chunk, int(memory_bytes // saved_bytes)))
    elif count <= chunk:
        return score(instance_index)
    parts = torch.split(instance_index, chunk, dim=1)
    return torch.cat([checkpoint(score, part, use_reentrant=False) if again else score(part) for part in parts])
