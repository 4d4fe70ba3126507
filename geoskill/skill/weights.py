"""Weights of a checkpoint, compared with its specification before anything of their size is built."""

from collections.abc import Mapping

import torch
from torch import Tensor

from geoskill.config import MODELS
from geoskill.errors import InputError, shown
from geoskill.skill.spec import SkillSpec, build_skill

# Fitted to a demonstration, which decides how long they are.
STATISTICS = ("spans", "beta", "node_order")


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
        expected = {key: value for key, value in member.state_dict().items() if key not in STATISTICS}
        lacking = [key for key in (*expected, *STATISTICS) if key not in own]
        unknown = [key for key in own if key not in (*expected, *STATISTICS)]
        if lacking or unknown:
            raise _misfit(f"{name} has {shown(unknown)} and lacks {shown(lacking)}")
        for key, value in expected.items():
            if own[key].shape != value.shape:
                raise _misfit(f"{name}.{key} is {shown(list(own[key].shape))}; expected {list(value.shape)}")
        first = member.extractors[member.kernel.roles[0]]
        _require_statistics(name, own, components.pipelines[first].descriptor_dim)


def _require_statistics(name: str, weights: Mapping[str, Tensor], width: int) -> None:
    spans, beta, order = (weights[key] for key in STATISTICS)
    if spans.ndim != 1 or spans.shape != beta.shape:
        raise _misfit(
            f"{name} has spans {shown(list(spans.shape))} and beta {shown(list(beta.shape))}; expected as many"
        )
    if order.ndim != 1 or len(order) not in (0, width):
        raise _misfit(f"{name}.node_order is {shown(list(order.shape))}; expected {width} numbers, or none")


def _misfit(reason: str) -> InputError:
    return InputError(f"its weights do not fit its specification ({reason})")
