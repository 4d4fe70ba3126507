"""An edited task definition: members left out, other tolerances, pinned associations.

The edited file is data. It is compared with the skill, and with the definition beside the skill where there is one:
whatever differs, and is none of the edits below, is refused with its name and line. Nothing of it is called, imported
or opened.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, final

from geoskill.errors import InputError, shown
from geoskill.io.marked_yaml import Marked, read_marked_yaml
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.build import SkillComponents
from geoskill.skill.member_status import MemberStatus
from geoskill.skill.pin import Pin, decoded_descriptor
from geoskill.skill.spec import SkillSpec

DEFINITION: Final = "skill.yaml"
EDITING: Final = """\
# What a skill has learned. A copy of this file can be edited, and then be obeyed: infer.py skill=RUN definition=COPY,
# likewise evaluate.py. A member can be left out, its goal_tolerance changed, and its pin set to the number of one of
# its associations, which then is the only one that it selects. Everything else is a record, and stays as it is.
"""
MAX_TOLERANCE: Final = 1e6


@final
@dataclass(frozen=True)
class DefinitionEdit:
    """What an edited definition changes.

    Attributes:
        members: names of the members that stay.
        tolerances: new tolerances of goal errors by the member's name, in the unit of the error.
        pins: pinned associations by the member's name.
    """

    members: tuple[str, ...]
    tolerances: Mapping[str, float]
    pins: Mapping[str, Pin]

    def applied(self, components: SkillComponents, spec: SkillSpec) -> tuple[SkillComponents, SkillSpec]:
        """Return members, pipelines and specification of the edited skill; what is given stays as it is."""
        members = {name: components.members[name] for name in self.members}
        for name, tolerance in self.tolerances.items():
            members[name] = copy.deepcopy(members[name])
            members[name].goal.set_tolerance(tolerance)
        used = {extractor for member in members.values() for extractor in member.extractors.values()}
        return (
            SkillComponents(members, {name: own for name, own in components.pipelines.items() if name in used}),
            replace(
                spec,
                members={name: own for name, own in spec.members.items() if name in members},
                extractors={name: own for name, own in spec.extractors.items() if name in used},
            ),
        )


def read_edit(path: str | Path, components: SkillComponents, original: Path | None = None) -> DefinitionEdit:
    """Read an edited task definition.

    Args:
        path: the edited file.
        components: of the skill.
        original: the definition that was edited. Where there is none, only what says which skill it is of is compared.

    Raises:
        InputError: when the file is no definition of this skill, or has an edit that cannot be made.
    """
    path = Path(path)
    edited = read_marked_yaml(path)
    reader = _Reader(path, edited, components)
    edit = reader.edit()
    if original is not None and original.is_file():
        _require_same(path, edited, read_marked_yaml(original), "")
    return edit


def shown_tolerance(member: KernelModel) -> float:
    """Return the tolerance of a member's goal error as it is written: to micrometers, or to three decimals."""
    return round(float(member.goal.tolerance), 6 if member.kernel.unit == "m" else 3)


@final
class _Reader:
    """The edits of a file.

    Args:
        path: of the file, for messages.
        definition: its content.
        components: of the skill.
    """

    def __init__(self, path: Path, definition: Marked, components: SkillComponents) -> None:
        self._path = path
        self._definition = definition
        self._components = components

    def edit(self) -> DefinitionEdit:
        members = _entry(self._path, self._definition, "", "members")
        known = self._components.members
        if not isinstance(members.value, dict) or not members.value:
            raise _refused(self._path, members, "members", f"expected at least one of {', '.join(known)}")
        tolerances: dict[str, float] = {}
        pins: dict[str, Pin] = {}
        for name, entry in members.value.items():
            if name not in known:
                expected = f"expected {', '.join(known)}"
                raise InputError(f"{self._path} line {entry.line}: the skill has no member {shown(name)}; {expected}")
            self._require_identity(name, entry)
            tolerance = self._tolerance(name, entry)
            if tolerance is not None:
                tolerances[name] = tolerance
            pin = self._pin(name, entry)
            if pin is not None:
                pins[name] = pin
        return DefinitionEdit(tuple(name for name in known if name in members.value), tolerances, pins)

    def _require_identity(self, name: str, entry: Marked) -> None:
        """Refuse the definition of another skill."""
        member = self._components.members[name]
        status = MemberStatus.lost(name, member)
        expected = {
            "kernel": member.kernel.name,
            "descriptor": member.descriptor,
            "error_rows": list(status.rows),
            "unit": status.unit,
        }
        for key, value in expected.items():
            own = _entry(self._path, entry, f"members.{name}.", key)
            if own.plain() != value:
                raise _refused(self._path, own, f"members.{name}.{key}", f"expected {shown(value)}, as it was learned")

    def _tolerance(self, name: str, entry: Marked) -> float | None:
        """Return a changed tolerance."""
        where = f"members.{name}.goal_tolerance"
        own = _entry(self._path, entry, f"members.{name}.", "goal_tolerance")
        goal = self._components.members[name].goal
        if not goal.is_fitted:
            if own.value is not None:
                raise _refused(self._path, own, where, "expected null, for no goal was learned that it could belong to")
            return None
        if isinstance(own.value, bool) or not isinstance(own.value, int | float) or not 0 < own.value <= MAX_TOLERANCE:
            unit = self._components.members[name].kernel.unit
            expected = f"expected a number above 0 and up to {MAX_TOLERANCE:g} {unit}".rstrip()
            raise _refused(self._path, own, where, expected)
        # The file has some decimals; an unchanged one leaves the learned tolerance as it is.
        unchanged = own.value == shown_tolerance(self._components.members[name])
        return None if unchanged else float(own.value)

    def _pin(self, name: str, entry: Marked) -> Pin | None:
        """Return a pinned association."""
        where = f"members.{name}.pin"
        own = _entry(self._path, entry, f"members.{name}.", "pin")
        if own.value is None:
            return None
        descriptors = _entry(self._path, self._definition, "", "descriptors")
        listed = _entry(self._path, descriptors, "descriptors.", name)
        count = len(listed.value) if isinstance(listed.value, list) else 0
        if count == 0:
            raise _refused(self._path, own, where, "expected null, for the member has no association to pin")
        if isinstance(own.value, bool) or not isinstance(own.value, int) or not 1 <= own.value <= count:
            numbers = "1" if count == 1 else f"the number of one of its associations, 1 to {count}"
            raise _refused(self._path, own, where, f"expected {numbers}, or null")
        assert isinstance(listed.value, list)
        nodes = listed.value[own.value - 1]
        member = self._components.members[name]
        texts = nodes.value if isinstance(nodes.value, list) else []
        where = f"descriptors.{name}[{own.value}]"
        if len(texts) != len(member.kernel.roles):
            raise _refused(self._path, nodes, where, f"expected {len(member.kernel.roles)} descriptors")
        decoded = []
        for text, kind in zip(texts, member.kernel.roles, strict=True):
            dim = self._components.pipelines[member.extractors[kind]].descriptor_dim
            try:
                decoded.append(decoded_descriptor(str(text.value), dim))
            except ValueError as error:
                raise InputError(f"{self._path} line {text.line}: {where} {error}") from error
        return Pin(own.value, decoded)


EDITABLE: Final = ("goal_tolerance", "pin")


def _require_same(path: Path, edited: Marked, original: Marked, where: str) -> None:
    """Refuse what differs from the original and is no edit."""
    new, old = edited.value, original.value
    if isinstance(new, dict) and isinstance(old, dict):
        for key, own in new.items():
            if key not in old:
                raise InputError(f"{path} line {own.line}: {where}{key} is no entry of it; expected {', '.join(old)}")
        # Members can be left out, and their descriptors with them.
        lacking = [key for key in old if key not in new and where not in ("members.", "descriptors.")]
        if lacking:
            raise InputError(f"{path} line {edited.line}: {where}{lacking[0]} is missing; expected it as it was")
        is_member = where.startswith("members.") and where.count(".") == 2
        for key, own in new.items():
            if not (is_member and key in EDITABLE):
                _require_same(path, own, old[key], f"{where}{key}.")
    elif isinstance(new, list) and isinstance(old, list) and len(new) == len(old):
        for number, (own, learned) in enumerate(zip(new, old, strict=True), start=1):
            _require_same(path, own, learned, f"{where[:-1]}[{number}].")
    elif edited.plain() != original.plain():
        raise _refused(path, edited, where[:-1], f"expected {shown(original.plain())}: it is a record, and not edited")


def _entry(path: Path, mapping: Marked, where: str, key: str) -> Marked:
    if not isinstance(mapping.value, dict):
        raise _refused(path, mapping, where.rstrip(".") or "the definition", f"expected a mapping with {key}")
    if key not in mapping.value:
        raise InputError(f"{path} line {mapping.line}: {where}{key} is missing; expected it as it was")
    return mapping.value[key]


def _refused(path: Path, own: Marked, name: str, expected: str) -> InputError:
    value = own.plain()
    return InputError(f"{path} line {own.line}: {name} is {'null' if value is None else shown(value)}; {expected}")
