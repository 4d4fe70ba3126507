"""Weights of a checkpoint, compared with its specification before anything of their size is built."""

from collections.abc import Mapping

import torch
from torch import Tensor

from geoskill.config import MODELS
from geoskill.errors import InputError, shown
from geoskill.features.pipeline import FeaturePipeline
from geoskill.kernels.kernel import node_dim
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.build import build_skill
from geoskill.skill.spec import SkillSpec

# Fitted to a demonstration, which decides how long they are.
STATISTICS = ("spans", "beta", "node_order", "evidence_values", "settling_values")
LEVEL = "level_values"
"""Another one, which the first checkpoints of this format lack."""
GOAL = "goal."
MAX_GOAL_ROWS = 4096
"""Largest number of features that a skill remembers of the end of its demonstration, of each kind."""


def require_finite(weights: Mapping[str, Tensor]) -> None:
    """Refuse weights or statistics that are not finite: whatever is computed with them is no number either.

    Raises:
        InputError: that names the first one.
    """
    for name, weight in weights.items():
        if not torch.isfinite(weight).all():
            raise InputError(f"{name[:80]} is not finite; expected the weights of a training that did not diverge")


def require_fit(spec: SkillSpec, weights: Mapping[str, Mapping[str, Tensor]]) -> None:
    """Refuse weights of other names or shapes than the specified members have, before these are built.

    Networks of other packages may do anything when they are built: theirs are compared when they are loaded.

    Args:
        spec: what the members are made of.
        weights: of each member, by the names of its state.

    Raises:
        InputError: that names the first difference, or a part that cannot be built.
    """
    if spec.model.name not in MODELS:
        return
    with torch.device("meta"):
        components = build_skill(spec)
    for name, member in components.members.items():
        own = weights[name]
        expected = {key: value for key, value in member.state_dict().items() if key not in (*STATISTICS, LEVEL)}
        lacking = [key for key in (*expected, *STATISTICS) if key not in own]
        unknown = [key for key in own if key not in (*expected, *STATISTICS, LEVEL)]
        if lacking or unknown:
            raise _misfit(f"{name} has {shown(unknown)} and lacks {shown(lacking)}")
        for key, value in expected.items():
            if key.startswith(GOAL) and value.numel() == 0:  # as many rows as the demonstration gave
                fits = own[key].ndim == value.ndim and len(own[key]) <= MAX_GOAL_ROWS
            else:
                fits = own[key].shape == value.shape
            if not fits:
                raise _misfit(f"{name}.{key} is {shown(list(own[key].shape))}; expected {list(value.shape)}")
        first = member.extractors[member.kernel.roles[0]]
        _require_goal(name, member, own, components.pipelines)
        _require_statistics(name, own, components.pipelines[first].descriptor_dim)


def _require_goal(
    name: str, member: KernelModel, weights: Mapping[str, Tensor], pipelines: Mapping[str, FeaturePipeline]
) -> None:
    """Refuse features of the demonstration's end that are not as wide as those of its frames, or not as many."""
    kinds = {f"node{node}": kind for node, kind in enumerate(member.kernel.roles)}
    kinds |= {f"{kind}_{group}": kind for kind in member.node_types for group in ("resting", "carried")}
    for prefix, kind in kinds.items():
        descriptors, ends = (weights[f"{GOAL}{prefix}_{part}"] for part in ("descriptor", "end"))
        widths = pipelines[member.extractors[kind]].descriptor_dim, node_dim(member.kernel, kind)
        if len(descriptors) != len(ends) or (len(ends) and (descriptors.shape[1], ends.shape[1]) != widths):
            raise _misfit(
                f"{name}.{GOAL}{prefix} is {shown(list(descriptors.shape))} and {shown(list(ends.shape))}; expected as"
                f" many rows, of {widths[0]} and {widths[1]}"
            )
    if len(weights[f"{GOAL}moving"]) not in (0, len(member.kernel.roles)):
        raise _misfit(
            f"{name}.{GOAL}moving is {shown(list(weights[f'{GOAL}moving'].shape))}; expected one for each node"
        )


def _require_statistics(name: str, weights: Mapping[str, Tensor], width: int) -> None:
    spans, beta, order = (weights[key] for key in STATISTICS[:3])
    for key in STATISTICS[3:]:
        if weights[key].shape not in ((0,), (3,)):
            raise _misfit(f"{name}.{key} is {shown(list(weights[key].shape))}; expected 3 numbers, or none")
    if LEVEL in weights and weights[LEVEL].shape not in ((0,), (1,)):
        raise _misfit(f"{name}.{LEVEL} is {shown(list(weights[LEVEL].shape))}; expected a number, or none")
    share = weights["settling_values"][:1].tolist()
    if not all(0 <= own <= 1 for own in share):
        raise _misfit(f"{name}.settling_values begins with {shown(share)}; expected a share from 0 to 1")
    if spans.ndim != 1 or spans.shape != beta.shape:
        raise _misfit(
            f"{name} has spans {shown(list(spans.shape))} and beta {shown(list(beta.shape))}; expected as many"
        )
    if order.ndim != 1 or len(order) not in (0, width):
        raise _misfit(f"{name}.node_order is {shown(list(order.shape))}; expected {width} numbers, or none")


def _misfit(reason: str) -> InputError:
    return InputError(f"its weights do not fit its specification ({reason})")
