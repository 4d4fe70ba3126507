"""A select-out by likeness to the demonstration: a mixture over what was seen there.

A network that was trained on a few dozen things is free in what it says of any other, and is as sure of it: joined to
an unknown corner of a gripper, a known point can earn the largest score of the frame. Here the score of an instance is
the logarithm of a sum of likenesses, which falls the farther a feature is from all that the demonstration has shown::

    u_cr(f) = sum_k exp(a_crk + (f . p_k - 1) / w)                   of role r in component c
    b       = 4 log sum_orders sum_c prod_r u_cr(f_order[r])   over the motif's automorphisms

The p_k are descriptors of the demonstration, kept as they are; the weights a are learned. It is a Parzen
window over associations (Parzen 1962) whose weights are those of the objective in place of counts, or a radial basis
function network (Broomhead and Lowe 1988) with a product on top. Not in the paper.
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

# Window w, as a share of the median of 1 - f . p over pairs of the demonstration's features: two features as far apart
# as most are have a likeness of exp(-18). It is h = 0.2 (w = h * h) on simulated sorting, where of 0.15, 0.2, 0.25 and
# 0.3 the first two are the best.
WINDOW_SHARE = 0.055
# Weights are this many times their parameters, which Adam moves by about its rate in each step: some hundred steps must
# be able to tell a prototype of the task from one of the background, which takes several nats.
GAIN = 10.0
# Fixed: when it was learned, it stayed within a fifth of this.
SCALE = 4.0
# Of features, for each instance: two where each pair of like features is one, and not many more.
MOST_PAIRS = 4


@final
class PrototypeMixture(InstanceScorer):
    """Scores instances by how much their features are like those of the demonstration, and which of them.

    Until :meth:`remember` is called, all prototypes are zero and all instances earn the same.

    Args:
        motif: what an instance looks like.
        prototypes: K, how many of the demonstration's features are kept for each node type.
        components: C, how many kinds of association the mixture has; each has its own weights in every role.

    Raises:
        InputError: when a number is below 1.
    """

    name: ClassVar[str] = "prototypes"

    def __init__(self, motif: Motif, *, prototypes: int, components: int = 16) -> None:
        super().__init__()
        for name, value in (("prototypes", prototypes), ("components", components)):
            if value < 1:
                raise InputError(f"model.{name}={value}: expected at least 1")
        self.motif = motif
        self.weights = nn.ParameterList(torch.randn(prototypes, components) / GAIN for _ in motif.roles)
        for kind, dim in motif.descriptor_dims.items():
            self.register_buffer(f"{kind}_prototypes", torch.zeros(prototypes, dim))
            self.register_buffer(f"{kind}_window", torch.ones(()))

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """Keep K features of each type as prototypes, spread evenly over those given; again and again if they are few.

        The window is fitted to them. Unit-norm descriptors are expected.

        Raises:
            ValueError: when there is no feature of a type.
        """
        for kind, rows in descriptors.items():
            if len(rows) == 0:
                raise ValueError(f"no {kind} to remember; expected the demonstration's features")
            prototypes = self.get_buffer(f"{kind}_prototypes")
            # A golden-ratio sequence: spread over the demonstration and over the ranks of strength within each frame.
            places = (torch.arange(len(prototypes), dtype=torch.float64) * (5**0.5 - 1) / 2 % 1.0 * len(rows)).long()
            prototypes.copy_(rows[places])
            apart = 1.0 - prototypes @ prototypes.T
            window = WINDOW_SHARE * apart[~torch.eye(len(apart), dtype=torch.bool)].median()
            if window > 0:  # not of a single feature, which is apart from nothing
                self.get_buffer(f"{kind}_window").copy_(window)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """See :meth:`InstanceScorer.forward`."""
        # Per feature, so that an instance only has a few numbers to add. Over the nearest prototype's, so that nothing
        # underflows far from all of them.
        nearest, relative = {}, {}
        for kind, rows in descriptors.items():
            log_likeness = self._log_likeness(kind, rows)
            nearest[kind] = log_likeness.amax(dim=1, keepdim=True).detach()
            relative[kind] = torch.exp(log_likeness - nearest[kind])
        mixed = [
            relative[role] @ torch.exp(GAIN * row) for role, row in zip(self.motif.roles, self.weights, strict=True)
        ]
        if _as_table(mixed, instance_index.shape[1]):
            table = mixed[0] @ mixed[1].T
            if len(self.motif.automorphisms) == 2:
                table = table + table.T  # in either order
            first, second = (nearest[role] for role in self.motif.roles)
            scores = SCALE * (torch.log(table) + first + second.T)
            return scores[instance_index[0], instance_index[1]]
        logs = [nearest[role] + torch.log(u) for role, u in zip(self.motif.roles, mixed, strict=True)]
        terms = [
            torch.stack([logs[role][instance_index[node]] for role, node in enumerate(order)]).sum(dim=0)
            for order in self.motif.automorphisms
        ]
        return SCALE * torch.cat(terms, dim=1).logsumexp(dim=1)

    def _log_likeness(self, kind: NodeType, rows: Float[Tensor, "n d"]) -> Float[Tensor, "n K"]:
        prototypes, window = self.get_buffer(f"{kind}_prototypes"), self.get_buffer(f"{kind}_window")
        return (rows @ prototypes.T - 1.0) / window


def _as_table(mixed: Sequence[Float[Tensor, "_ C"]], count: int) -> bool:
    """Whether one product of matrices gives the sum over components for all pairs of features, and is worth it.

    It is when most pairs are instances; in a batch, most are of two frames. And no summand may overflow or underflow:
    learned weights are some ten nats apart, and it takes forty, but nothing forbids them.
    """
    pairs = math.prod(len(u) for u in mixed)
    if len(mixed) != 2 or not 0 < pairs <= MOST_PAIRS * count:
        return False
    limits = torch.finfo(mixed[0].dtype)
    smallest, largest = (math.prod(float(of(u.detach())) for u in mixed) for of in (torch.amin, torch.amax))
    return smallest > limits.tiny and 2 * mixed[0].shape[1] * largest < limits.max
