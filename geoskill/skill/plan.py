"""From what a user asks for to the specification of a skill: a member for every kernel and descriptor that fit."""

from dataclasses import replace
from itertools import product

from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import node_types
from geoskill.plugins import EXTRACTORS, KERNELS, Registry
from geoskill.schema import as_plain
from geoskill.skill.spec import MemberSpec, Part, Plain, SkillSpec, network_part

# Taken where none is named that describes the type.
ONLY_DESCRIPTOR = {NodeType.PLANE: "planes", NodeType.CONIC: "conics"}


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
    network = network_part(model)
    cascade = network.arguments.get("cascade")
    if isinstance(cascade, int) and cascade < top_k:
        raise InputError(
            f"cascade={cascade}: expected at least top_k={top_k}, the associations that are listed of a frame, or null"
        )
    described, node_type_of = {}, {}
    for name, arguments in named_parts(descriptor, EXTRACTORS).items():
        part = Part.of(EXTRACTORS, name, arguments)
        extractor = part.build(EXTRACTORS)
        # As the extractor keeps them: of a file of weights, its digest.
        described[name] = replace(
            part, arguments={key: getattr(extractor, key, own) for key, own in part.arguments.items()}
        )
        node_type_of[name] = extractor.node_type
    members: dict[str, MemberSpec] = {}
    for kernel_name, kernel_arguments in named_parts(kernel, KERNELS).items():
        part = Part.of(KERNELS, kernel_name, kernel_arguments)
        choices = []
        for node_type in node_types(part.build(KERNELS)):
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
