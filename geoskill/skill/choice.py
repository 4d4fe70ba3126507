"""``kernel=auto``: the kernels that a demonstration may be about, and which of their members were kept."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, final

from geoskill.config import AUTO, FeaturesConfig
from geoskill.errors import InputError, shown
from geoskill.plugins import EXTRACTORS, KERNELS
from geoskill.schema import as_plain
from geoskill.skill.plain import mapping_of, text_of
from geoskill.skill.plan import named_parts, plan_skill
from geoskill.skill.spec import SkillSpec

CANDIDATES: Final = ("p2p", "l2l", "p2l", "par")
"""Kernels between what the pictures of one camera show."""


@final
@dataclass(frozen=True)
class Choice:
    """The members that describe a demonstration.

    Attributes:
        kept: their names.
        dropped: why, by the names of the others.
    """

    kept: tuple[str, ...]
    dropped: Mapping[str, str]

    def as_plain(self) -> dict[str, Any]:
        """Return it as written to checkpoints, ``metrics.json`` and ``skill.yaml``."""
        return {"kept": list(self.kept), "dropped": dict(self.dropped)}

    def statements(self) -> list[str]:
        """Return what was kept, and why the others were not, one line each."""
        return [
            f"kept: {', '.join(self.kept)}",
            *(f"dropped {name}: {reason}" for name, reason in self.dropped.items()),
        ]

    @classmethod
    def from_plain(cls, value: object, where: str) -> "Choice":
        """Read that of a checkpoint.

        Raises:
            InputError: when it is something else.
        """
        entries = mapping_of(value, where, ("kept", "dropped"))
        if not isinstance(entries["kept"], list):
            raise InputError(f"the skill's {where}.kept is {shown(entries['kept'])}; expected a list")
        kept = tuple(text_of(name, f"{where}.kept") for name in entries["kept"])
        dropped = mapping_of(entries["dropped"], f"{where}.dropped")
        return cls(kept, {name: text_of(reason, f"{where}.dropped.{name}") for name, reason in dropped.items()})


def is_auto(kernel: object) -> bool:
    """Return whether the kernels are to be chosen by the demonstration.

    Raises:
        InputError: when some are named beside ``auto``, or it has arguments.
    """
    given = as_plain(kernel)
    named = named_parts(given, KERNELS) if isinstance(given, str | list | dict) and given else {}
    if AUTO not in named:
        return False
    if len(named) > 1 or named[AUTO]:
        raise InputError(f"kernel={given}: expected auto alone, or the names of kernels")
    return True


def plan_candidates(descriptor: object, model: object, features: FeaturesConfig, top_k: int) -> SkillSpec:
    """Return the specification with one member for every candidate and every descriptor that fits its nodes.

    The arguments and errors are those of :func:`~geoskill.skill.plan.plan_skill`. Candidates with nodes that nothing
    describes are left out.
    """
    described = {
        EXTRACTORS.build(name, arguments)().node_type for name, arguments in named_parts(descriptor, EXTRACTORS).items()
    }
    kernels = [name for name in CANDIDATES if described.issuperset(KERNELS.build(name, {})().roles)]
    return plan_skill(kernels, descriptor, model, features, top_k)


def only(spec: SkillSpec, names: tuple[str, ...]) -> SkillSpec:
    """Return a specification with these of its members, and the extractors that feed them."""
    members = {name: member for name, member in spec.members.items() if name in names}
    used = {name for member in members.values() for name in member.extractors.values()}
    extractors = {name: part for name, part in spec.extractors.items() if name in used}
    return replace(spec, members=members, extractors=extractors)
