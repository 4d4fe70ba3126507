"""A select-out by similarity to the demonstration: a mixture over associations of its features.

The score of a trained network is arbitrary for features unlike those it was trained on, and just as large: joined to
an unknown corner of a gripper, a known point can earn the largest score of the frame. Here the score of an instance is
the logarithm of a sum of similarities, which falls with the distance of a feature from every feature of the
demonstration::

    u_cr(f) = sum_k exp(a_crk + (f . p_k - 1) / w)                   for role r in component c
    b       = 4 log sum_orders sum_c prod_r u_cr(f_order[r])   over the motif's automorphisms

The p_k are descriptors of the demonstration, kept as they are; the weights a are learned. This is a Parzen window over
associations (Parzen 1962) whose weights come from the objective in place of counts, or a radial basis function network
(Broomhead and Lowe 1988) with a product on top. It is not in the paper.
"""

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.scorer import InstanceScorer, Motif

# Window w over the median of 1 - f . p between the demonstration's features: at the median distance the similarity is
# exp(-18) (docs/experiments/look-alikes.md).
WINDOW_SHARE = 0.055
# A weight is its parameter times this. Adam moves a parameter by about its rate per step, and within some hundred steps
# a prototype of the task must get several nats ahead of one of the background.
GAIN = 10.0
# Fixed, since learning it hardly changed it (docs/experiments/look-alikes.md).
SCALE = 4.0
# All pairs of features are computed at once up to this many pairs per instance: about two when instances are unordered
# pairs, and a few more are still worth it.
MAX_PAIRS_PER_INSTANCE = 4


@final
class PrototypeMixture(InstanceScorer):
    """A scorer by the similarity of an instance's features to those of the demonstration.

    Until :meth:`fit_prototypes` is called, all prototypes are zero and all instances have the same score.

    Args:
        motif: the motif of the instances.
        prototypes: K, the number of the demonstration's features that are kept for each node type.
        components: C, the number of components of the mixture; each has its own weights in every role.

    Raises:
        InputError: when a number is below 1.
    """

    name: ClassVar[str] = "prototypes"

    def __init__(self, motif: Motif, *, prototypes: int, components: int = 16) -> None:
        super().__init__()
        for argument, value in (("prototypes", prototypes), ("components", components)):
            if value < 1:
                raise InputError(f"{argument}={value}: expected at least 1")
        self.motif = motif
        self.weights = nn.ParameterList(torch.randn(prototypes, components) / GAIN for _ in motif.roles)
        for node_type, dim in motif.descriptor_dims.items():
            self.register_buffer(f"{node_type}_prototypes", torch.zeros(prototypes, dim))
            self.register_buffer(f"{node_type}_window", torch.ones(()))

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """Keep K features of each type as prototypes, and fit the window to their distances.

        The prototypes are spread evenly over the given features, which are repeated when there are fewer than K.

        Args:
            descriptors: those of all features of the demonstration, unit norm.

        Raises:
            ValueError: when there is no feature of a type.
        """
        for node_type, rows in descriptors.items():
            if len(rows) == 0:
                raise ValueError(f"no {node_type} descriptors; expected those of the demonstration's features")
            prototypes = self.get_buffer(f"{node_type}_prototypes")
            # A golden-ratio sequence: spread over the demonstration and over the ranks of strength within each frame.
            chosen = (torch.arange(len(prototypes), dtype=torch.float64) * (5**0.5 - 1) / 2 % 1.0 * len(rows)).long()
            prototypes.copy_(rows[chosen])
            distances = 1.0 - prototypes @ prototypes.T
            window = WINDOW_SHARE * distances[~torch.eye(len(distances), dtype=torch.bool)].median()
            if window > 0:  # a single feature has no distance to another
                self.get_buffer(f"{node_type}_window").copy_(window)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """Score instances; see :meth:`InstanceScorer.forward`."""
        # Computed per feature, so that an instance only adds a few numbers, and relative to the nearest prototype, so
        # that nothing underflows far from all of them.
        nearest, relative = {}, {}
        for node_type, rows in descriptors.items():
            log_similarity = self._log_similarity(node_type, rows)
            nearest[node_type] = log_similarity.amax(dim=1, keepdim=True).detach()
            relative[node_type] = torch.exp(log_similarity - nearest[node_type])
        mixed = [
            relative[role] @ torch.exp(GAIN * weights)
            for role, weights in zip(self.motif.roles, self.weights, strict=True)
        ]
        if _pays_as_table(mixed, instance_index.shape[1]):
            table = mixed[0] @ mixed[1].T
            if len(self.motif.automorphisms) == 2:
                table = table + table.T  # sum over both orders
            first, second = (nearest[role] for role in self.motif.roles)
            scores = SCALE * (torch.log(table) + first + second.T)
            return scores[instance_index[0], instance_index[1]]
        logs = [nearest[role] + torch.log(u) for role, u in zip(self.motif.roles, mixed, strict=True)]
        pairs = sorted({(role, node) for order in self.motif.automorphisms for role, node in enumerate(order)})
        # Gathered once, however many orders there are: twenty-four of four alike.
        gathered = {(role, node): logs[role][instance_index[node]] for role, node in pairs}
        terms = [
            torch.stack([gathered[role, node] for role, node in enumerate(order)]).sum(dim=0)
            for order in self.motif.automorphisms
        ]
        return SCALE * torch.cat(terms, dim=1).logsumexp(dim=1)

    def _log_similarity(self, node_type: NodeType, rows: Float[Tensor, "n d"]) -> Float[Tensor, "n K"]:
        prototypes, window = self.get_buffer(f"{node_type}_prototypes"), self.get_buffer(f"{node_type}_window")
        return (rows @ prototypes.T - 1.0) / window


def _pays_as_table(mixed: Sequence[Float[Tensor, "_ C"]], count: int) -> bool:
    """Tell whether one product of matrices can and should give the sum over components for all pairs of features.

    It pays when most pairs are instances; in a batch, most pairs are of two frames. And no summand may overflow or
    underflow: that takes weights forty nats apart, learned ones are some ten apart, but nothing forbids more.
    """
    pairs = math.prod(len(u) for u in mixed)
    if len(mixed) != 2 or not 0 < pairs <= MAX_PAIRS_PER_INSTANCE * count:
        return False
    limits = torch.finfo(mixed[0].dtype)
    smallest, largest = (math.prod(float(extreme(u.detach())) for u in mixed) for extreme in (torch.amin, torch.amax))
    return smallest > limits.tiny and 2 * mixed[0].shape[1] * largest < limits.max
