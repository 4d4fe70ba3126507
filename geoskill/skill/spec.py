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

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from itertools import product
from typing import Any, final

import torch

from geoskill.config import MAX_TOP_K, MODELS, FeaturesConfig
from geoskill.errors import InputError, shown
from geoskill.features.cache import FeatureCache
from geoskill.features.learned_weights import DIGEST
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import EXTRACTORS, KERNELS, NAME, PACKAGE, SCORERS, Registry
from geoskill.schema import as_plain, settings_of
from geoskill.skill.plain import mapping_of, text_of

FORMAT = 5
# Taken where none is named that describes the type.
ONLY_DESCRIPTOR = {NodeType.PLANE: "planes", NodeType.CONIC: "conics"}
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
        members = {}
        for name, member in _parts_of(entries["members"], "members").items():
            own = mapping_of(member, f"members.{name}", ("kernel", "extractors"))
            feeds = mapping_of(own["extractors"], f"members.{name}.extractors")
            for node_type, extractor in feeds.items():
                if node_type not in tuple(NodeType):
                    raise InputError(
                        f"the skill's members.{name}.extractors has {shown(node_type)}; expected"
                        f" {' or '.join(NodeType)}"
                    )
                if text_of(extractor, f"members.{name}.extractors.{node_type}") not in extractors:
                    raise InputError(
                        f"the skill's members.{name}.extractors.{node_type} is {shown(extractor)}; expected one of"
                        f" {', '.join(extractors)}"
                    )
            members[name] = MemberSpec(Part.from_plain(own["kernel"], f"members.{name}.kernel"), feeds)
        top_k = entries["top_k"]
        if not members or type(top_k) is not int or top_k < 1:
            raise InputError(
                f"the skill has {len(members)} members and top_k={shown(top_k)}; expected at least 1 of each"
            )
        if top_k > MAX_TOP_K:
            raise InputError(f"the skill's top_k is {top_k}; expected at most {MAX_TOP_K}")
        model = Part.from_plain(entries["model"], "model")
        if model.name in MODELS:  # whose arguments have types and ranges
            model = replace(model, arguments=_plan_network({**model.arguments, "name": model.name}).arguments)
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
        return cls(
            parts,
            members,
            model,
            features,
            top_k,
        )


@final
@dataclass(frozen=True, eq=False)
class SkillComponents:
    """The objects of a skill: members and feature pipelines, both by name."""

    members: dict[str, KernelModel]
    pipelines: dict[str, FeaturePipeline]

    def only(self, spec: SkillSpec) -> "SkillComponents":
        """Return those of a specification, of the members of which these are all, or more."""
        return SkillComponents(
            {name: self.members[name] for name in spec.members},
            {name: self.pipelines[name] for name in spec.extractors},
        )


def plan_skill(kernel: object, descriptor: object, model: object, features: FeaturesConfig, top_k: int) -> SkillSpec:
    """Return the specification with one member for every kernel and every descriptor that fits its nodes.

    Args:
        kernel: a name, names, or names with arguments; ``p2p_l2l`` stands for both kernels.
        descriptor: likewise, without the short form.
        model: a name, or a mapping (or configuration class) of ``name`` and arguments.
        features: settings of the feature pipelines.
        top_k: associations listed per frame and member.

    Raises:
        InputError: when a name or argument is unknown, a kernel has a node type that no descriptor describes, or the
            cascade of the network looks at fewer instances than are listed.
    """
    network = _plan_network(model)
    cascade = network.arguments.get("cascade")
    if isinstance(cascade, int) and cascade < top_k:
        raise InputError(
            f"cascade={cascade}: expected at least top_k={top_k}, the associations that are listed of a frame, or null"
        )
    described, node_type_of = {}, {}
    for name, arguments in named_parts(descriptor, EXTRACTORS).items():
        part = Part.of(EXTRACTORS, name, arguments)
        extractor = _build(EXTRACTORS, part)
        # As the extractor keeps them: of a file of weights, its digest.
        described[name] = replace(
            part, arguments={key: getattr(extractor, key, own) for key, own in part.arguments.items()}
        )
        node_type_of[name] = extractor.node_type
    members: dict[str, MemberSpec] = {}
    for kernel_name, kernel_arguments in named_parts(kernel, KERNELS).items():
        part = Part.of(KERNELS, kernel_name, kernel_arguments)
        choices = []
        for node_type in node_types(_build(KERNELS, part)):
            usual = ONLY_DESCRIPTOR.get(node_type)
            if usual is not None and node_type not in node_type_of.values():
                described[usual], node_type_of[usual] = Part.of(EXTRACTORS, usual, {}), node_type
            fitting = [name for name, kind in node_type_of.items() if kind is node_type]
            if not fitting:
                known = ", ".join(f"{name} describes a {kind}" for name, kind in node_type_of.items())
                raise InputError(
                    f"kernel={kernel_name} joins a {node_type}, and {known}; expected a descriptor of a {node_type} too"
                    " (several are given as descriptor=[orb,lbd])"
                )
            choices.append([(str(node_type), name) for name in fitting])
        for choice in product(*choices):
            members["_".join([kernel_name, *(name for _, name in choice)])] = MemberSpec(part, dict(choice))
    used = {name for member in members.values() for name in member.extractors.values()}
    extractors = {name: part for name, part in described.items() if name in used}
    return SkillSpec(extractors, members, network, features, top_k)


def _plan_network(model: object) -> Part:
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


def named_parts(value: object, registry: Registry) -> dict[str, dict[str, Plain]]:
    """Return the names of a setting with their arguments.

    >>> named_parts(["sift", "lbd"], EXTRACTORS)
    {'sift': {}, 'lbd': {}}

    Raises:
        InputError: when it holds no name.
    """
    if isinstance(value, str):
        parts = value.split("_")
        ensemble = value not in registry.names() and all(part in registry.names() for part in parts)
        value = parts if ensemble else [value]
    value = as_plain(value)
    named = value if isinstance(value, dict) else {key: {} for key in value} if isinstance(value, list) else {}
    if not named or not all(isinstance(arguments, dict | None) for arguments in named.values()):
        raise InputError(f"{registry.kind}={value}: expected at least one of {', '.join(registry.names())}")
    return {name: dict(arguments or {}) for name, arguments in named.items()}


def build_skill(spec: SkillSpec, cache: FeatureCache | None = None, seed: int = 0) -> SkillComponents:
    """Build the members of a skill; the networks have fresh weights.

    These depend on the seed and the member's name, not on what other members there are or on what was drawn before.
    PyTorch's own generator is left as it was.

    Raises:
        InputError: when a part is not installed here, or does not take its arguments.
    """
    kernels: dict[str, Kernel] = {name: _build(KERNELS, member.kernel) for name, member in spec.members.items()}
    lifted = {
        extractor
        for name, member in spec.members.items()
        if kernels[name].in_space
        for extractor in member.extractors.values()
    }
    pipelines = {
        name: FeaturePipeline(_build(EXTRACTORS, part), cache=cache, in_space=name in lifted, **as_plain(spec.features))
        for name, part in spec.extractors.items()
    }
    members = {}
    for name, member in spec.members.items():
        kernel = kernels[name]
        extractors = {NodeType(kind): extractor for kind, extractor in member.extractors.items()}
        dims = {kind: pipelines[extractor].descriptor_dim for kind, extractor in extractors.items()}
        sides = {kind: pipelines[extractor].patch_side for kind, extractor in extractors.items()}
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(zlib.crc32(f"{seed} {name}".encode()))
            scorer: InstanceScorer = _build(SCORERS, spec.model, Motif.of(kernel, dims, sides))
        members[name] = KernelModel(kernel, extractors, scorer)
    return SkillComponents(members, pipelines)


def _parts_of(value: object, where: str) -> dict[str, Any]:
    parts = mapping_of(value, where)
    for name in parts:
        if not NAME.fullmatch(name):
            raise InputError(f"the skill's {where} has {shown(name)}; expected small letters, digits and underscores")
    if len(parts) > MAX_PARTS:
        raise InputError(f"the skill has {len(parts)} {where}; expected at most {MAX_PARTS}")
    return parts


def _build(registry: Registry, part: Part, *given: object) -> Any:
    try:
        return registry.build(part.name, part.arguments, part.package)(*given)
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{registry.kind}={part.name}: {error}") from error
