"""The specification of a skill: named parts with plain arguments, into which a checkpoint's weights fit.

::

    format: 5
    extractors: {sift: {name: sift, package: geoskill, arguments: {root: false, ...}}}
    members:    {p2p_sift: {kernel: {name: p2p, ...}, extractors: {point: sift}}}
    model:      {name: message_passing, package: geoskill, arguments: {hidden_dim: 32, ...}}
    features:   {max_features: 60, min_side: 480, max_side: 720, color: 8.0}
    top_k: 10

A checkpoint may come from anybody. Everything in it is read as plain values into the dataclasses below, with types
checked and unknown names refused; classes are found by name in the registries of :mod:`geoskill.plugins`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, final

from geoskill.config import MAX_TOP_K, MODELS, FeaturesConfig
from geoskill.errors import InputError, shown
from geoskill.features.learned_weights import DIGEST
from geoskill.geometry.primitives import NodeType
from geoskill.plugins import NAME, PACKAGE, SCORERS, Registry
from geoskill.schema import as_plain, settings_of
from geoskill.skill.plain import mapping_of, text_of

FORMAT = 5
MAX_PARTS = 64
"""Members, and extractors, of one skill."""

Plain = bool | int | float | str | None


@final
@dataclass(frozen=True)
class Part:
    """A class by its registered name, with a user's arguments.

    Attributes:
        name: as on the command line.
        package: the package to install for it.
        arguments: plain values.
    """

    name: str
    package: str
    arguments: Mapping[str, Plain]

    @classmethod
    def of(cls, registry: Registry, name: str, arguments: Mapping[str, Plain]) -> "Part":
        """Return the part with all of its arguments, defaults included.

        Raises:
            InputError: when there is no such class or argument.
        """
        registry.build(name, arguments)
        defaults = {
            key: parameter.default
            for key, parameter in registry.parameters(name).items()
            if parameter.default is not parameter.empty
        }
        return cls(name, registry.provider(name), {**defaults, **arguments})

    @classmethod
    def from_plain(cls, value: object, where: str) -> "Part":
        """Read a part of a checkpoint.

        Raises:
            InputError: when it is something else.
        """
        entries = mapping_of(value, where, ("name", "package", "arguments"))
        for key, pattern in (("name", NAME), ("package", PACKAGE)):
            if not pattern.fullmatch(text_of(entries[key], f"{where}.{key}")):
                raise InputError(
                    f"the skill's {where}.{key} is {shown(entries[key])}; expected the name of a class or package"
                )
        arguments = mapping_of(entries["arguments"], f"{where}.arguments")
        for key, argument in arguments.items():
            if not isinstance(argument, bool | int | float | str | None):
                raise InputError(f"the skill's {where}.arguments.{key} is {shown(argument)}; expected a plain value")
        return cls(entries["name"], entries["package"], arguments)

    def build(self, registry: Registry, *given: object) -> Any:
        """Return what the class makes of its arguments and what else it is given.

        Raises:
            InputError: when it is not installed here, or does not take its arguments.
        """
        try:
            return registry.build(self.name, self.arguments, self.package)(*given)
        except (TypeError, ValueError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"{registry.kind}={self.name}: {error}") from error


@final
@dataclass(frozen=True)
class MemberSpec:
    """A member of the ensemble: its kernel, and the extractor that feeds each node type."""

    kernel: Part
    extractors: Mapping[str, str]


@final
@dataclass(frozen=True)
class SkillSpec:
    """Everything that is needed to build a skill's members.

    Attributes:
        extractors: by name.
        members: by name, such as ``p2p_sift``: the kernel and the extractors of its node types.
        model: the network of every member.
        features: settings of the feature pipelines.
        top_k: associations listed per frame and member.
    """

    extractors: Mapping[str, Part]
    members: Mapping[str, MemberSpec]
    model: Part
    features: FeaturesConfig
    top_k: int

    def as_plain(self) -> dict[str, Any]:
        """Return the specification as it stands in a checkpoint."""
        return {"format": FORMAT, **as_plain(self)}

    @classmethod
    def from_plain(cls, value: object) -> "SkillSpec":
        """Read the specification of a checkpoint.

        Raises:
            InputError: when it is of another format, or has anything but plain values of the expected types.
        """
        found = value.get("format") if isinstance(value, Mapping) else None
        if found != FORMAT:
            raise InputError(
                f"the skill's format is {shown(found)}; expected {FORMAT} (learn it again with this version)"
            )
        entries = mapping_of(value, "specification", ("format", *(own.name for own in fields(cls))))
        extractors = _parts_of(entries["extractors"], "extractors")
        members = {
            name: _member(name, member, extractors) for name, member in _parts_of(entries["members"], "members").items()
        }
        top_k = entries["top_k"]
        if not members or type(top_k) is not int or top_k < 1:
            raise InputError(
                f"the skill has {len(members)} members and top_k={shown(top_k)}; expected at least 1 of each"
            )
        if top_k > MAX_TOP_K:
            raise InputError(f"the skill's top_k is {top_k}; expected at most {MAX_TOP_K}")
        model = Part.from_plain(entries["model"], "model")
        if model.name in MODELS:  # whose arguments have types and ranges
            model = replace(model, arguments=network_part({**model.arguments, "name": model.name}).arguments)
        settings = mapping_of(entries["features"], "features")
        if "max_side" not in settings:  # a skill from before there was one
            settings["max_side"] = 0
        settings = mapping_of(settings, "features", tuple(own.name for own in fields(FeaturesConfig)))
        try:
            features = FeaturesConfig(**settings)
        except InputError as error:
            raise InputError(f"the skill's features: {error}") from error
        parts = {name: Part.from_plain(part, f"extractors.{name}") for name, part in extractors.items()}
        for name, part in parts.items():
            weights = part.arguments.get("weights")
            if weights is not None and not DIGEST.fullmatch(str(weights)):  # a path would be read
                raise InputError(
                    f"the skill's extractors.{name}.arguments.weights is {shown(weights)}; expected a digest"
                )
        return cls(parts, members, model, features, top_k)


def network_part(model: object) -> Part:
    """Return the network of a name, or of a mapping (or configuration class) of ``name`` and arguments.

    Raises:
        InputError: when there is no such network or argument.
    """
    arguments = as_plain({"name": model} if isinstance(model, str) else model)
    if not isinstance(arguments, dict) or not isinstance(arguments.get("name"), str):
        raise InputError(f"model={model}: expected a name, or a mapping of name and arguments")
    name = arguments.pop("name")
    if name in MODELS:  # whose defaults and ranges are in the configuration
        known = [key for key, _, _ in settings_of(MODELS[name]) if key != "name"]
        for key in arguments:
            if key not in known:
                raise InputError(f"model={name} has no argument {key!r}; expected {', '.join(known)}")
        arguments = {key: value for key, value in as_plain(MODELS[name](**arguments)).items() if key != "name"}
    return Part.of(SCORERS, name, arguments)


def _member(name: str, value: object, extractors: Mapping[str, object]) -> MemberSpec:
    own = mapping_of(value, f"members.{name}", ("kernel", "extractors"))
    feeds = mapping_of(own["extractors"], f"members.{name}.extractors")
    for node_type, extractor in feeds.items():
        if node_type not in tuple(NodeType):
            raise InputError(
                f"the skill's members.{name}.extractors has {shown(node_type)}; expected {' or '.join(NodeType)}"
            )
        if text_of(extractor, f"members.{name}.extractors.{node_type}") not in extractors:
            raise InputError(
                f"the skill's members.{name}.extractors.{node_type} is {shown(extractor)}; expected one of"
                f" {', '.join(extractors)}"
            )
    return MemberSpec(Part.from_plain(own["kernel"], f"members.{name}.kernel"), feeds)


def _parts_of(value: object, where: str) -> dict[str, Any]:
    parts = mapping_of(value, where)
    for name in parts:
        if not NAME.fullmatch(name):
            raise InputError(f"the skill's {where} has {shown(name)}; expected small letters, digits and underscores")
    if len(parts) > MAX_PARTS:
        raise InputError(f"the skill has {len(parts)} {where}; expected at most {MAX_PARTS}")
    return parts
