"""Scoring of instances in chunks that fit the processor's cache, and within a limit on memory.

The intermediate results of an instance are large, its score is one number. A chunk whose intermediate results stay in
the cache is faster than all instances at once. When autograd cannot keep the intermediate results of all instances
until the backward pass, it keeps none, and each chunk is computed again when its gradient is due ("Training deep nets
with sublinear memory cost", Chen et al., 2016). This takes about half as long again and gives the same gradient.
"""

from collections.abc import Callable

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch.utils.checkpoint import checkpoint

MIB = 1 << 20
# Intermediate results per chunk; about the second and third level cache of a core.
CACHE_BYTES = 8 * MIB
# Larger on a GPU, whose cores want all work at once.
GPU_CHUNK_BYTES = 512 * MIB

Score = Callable[[Int64[Tensor, "k c"]], Float[Tensor, " c"]]


def in_chunks(
    score: Score, instance_index: Int64[Tensor, "k m"], *, working_bytes: int, saved_bytes: float, memory_bytes: float
) -> Float[Tensor, " m"]:
    """Return the scores of all instances, computed chunk by chunk.

    Args:
        score: computes the scores of some instances.
        instance_index: all instances.
        working_bytes: size of the largest intermediate result of one instance.
        saved_bytes: what autograd keeps of one instance.
        memory_bytes: what autograd may keep of all instances.
    """
    count = instance_index.shape[1]
    cache_bytes = GPU_CHUNK_BYTES if instance_index.is_cuda else CACHE_BYTES
    chunk_size = max(1, cache_bytes // working_bytes)
    recompute = torch.is_grad_enabled() and count * saved_bytes > memory_bytes
    if recompute:
        chunk_size = max(1, min(chunk_size, int(memory_bytes // saved_bytes)))
    elif count <= chunk_size:
        return score(instance_index)
    chunks = torch.split(instance_index, chunk_size, dim=1)
    return torch.cat([checkpoint(score, chunk, use_reentrant=False) if recompute else score(chunk) for chunk in chunks])
