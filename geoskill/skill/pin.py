"""An association that a person has pinned: of a member, only instances that join these features are selected."""

import base64
import binascii
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from torch import Tensor

from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import Kernel, automorphisms

# Smallest cosine of two descriptors that count as views of one feature. Two frames of one SIFT keypoint are mostly
# above 0.85, two unrelated keypoints below 0.6.
MIN_SIMILARITY = 0.75


@final
@dataclass(frozen=True, eq=False)
class Pin:
    """A pinned association.

    Attributes:
        number: of the association in the task definition.
        descriptors: of its nodes, each of unit norm.
    """

    number: int
    descriptors: Sequence[Float32[np.ndarray, " _"]]

    def allows(self, kernel: Kernel, graph: MotifGraph) -> Bool[Tensor, " m"]:
        """Return which instances of a frame join the pinned features, in any order that the motif does not tell apart.

        Args:
            kernel: of the member.
            graph: of the frame.
        """
        index: Int64[Tensor, "k m"] = graph.instance_index
        similar = [
            graph[f"{kind}_descriptor"] @ torch.from_numpy(own).to(index.device) >= MIN_SIMILARITY
            for kind, own in zip(kernel.roles, self.descriptors, strict=True)
        ]
        allowed = torch.zeros(index.shape[1], dtype=torch.bool, device=index.device)
        for order in automorphisms(kernel):
            rows = [similar[node][index[place]] for place, node in enumerate(order)]
            allowed |= torch.stack(rows).all(dim=0)
        return allowed


def encoded_descriptor(descriptor: Float32[np.ndarray, " d"]) -> str:
    """Return a descriptor as text: 8 bits for each number, whose largest is 127, in base 64."""
    scale = max(float(np.abs(descriptor).max()), 1e-12)
    return base64.b64encode(np.round(127 * descriptor / scale).astype(np.int8).tobytes()).decode("ascii")


def decoded_descriptor(text: str, dim: int) -> Float32[np.ndarray, " d"]:
    """Return the descriptor of a text, of unit norm.

    Args:
        text: see :func:`encoded_descriptor`.
        dim: of the descriptor.

    Raises:
        ValueError: when the text is no such descriptor.
    """
    try:
        numbers = np.frombuffer(base64.b64decode(text, validate=True), np.int8).astype(np.float32)
    except (ValueError, binascii.Error) as error:
        raise ValueError("is no descriptor") from error
    if len(numbers) != dim or not numbers.any():
        raise ValueError(f"is a descriptor of {len(numbers)} numbers; expected {dim}")
    return np.asarray(numbers / np.linalg.norm(numbers), np.float32)
