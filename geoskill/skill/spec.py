"""What a skill is made of, as plain values: the part of a checkpoint that its weights fit into.

::

    format: 2
    extractors: {sift: {_target_: geoskill.features.sift.Sift, ...}}
    members:    {p2p_sift: {kernel: {_target_: ...}, extractors: {point: sift}}}
    model:      {_target_: ..., _partial_: true, ...}
    features:   {max_features: 60, min_side: 480, color: 8.0}
    alternatives: 10
    demonstrations: 1
    learned_from: {task: sorting, seed: 0, scenario: {actor: human, ...}}  # if simulated; else it is not there
"""

import zlib
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from itertools import product
from typing import Any, final

import torch

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import InstanceScorer, Motif

FORMAT = 2


@final
@dataclass(frozen=True, eq=False)
class SkillComponents:
    """The objects of a skill: its members and the extractors that feed them, both by name, and what it was taught."""

    members: dict[str, KernelModel]
    pipelines: dict[str, FeaturePipeline]
    alternatives: int
    learned_from: Mapping[str, Any] = field(default_factory=dict)


def describe(
    kernels: Mapping[str, Any],
    descriptors: Mapping[str, Any],
    model: Mapping[str, Any],
    features: Mapping[str, Any],
    alternatives: int,
) -> dict[str, Any]:
    """The description of a skill with one member for every kernel and every descriptor that fits its nodes.

    All arguments hold plain values as in the configuration; ``features`` is what a pipeline is given.

    Raises:
        InputError: when a kernel has a node type that no descriptor describes, ``alternatives`` is below 1, or a
            cascade looks at fewer instances than are listed.
    """
    if alternatives < 1:
        raise InputError(f"inference.alternatives={alternatives}: expected at least 1")
    cascade = model.get("cascade")
    if cascade is not None and cascade < alternatives:
        raise InputError(
            f"model.cascade={cascade}: expected at least inference.alternatives={alternatives}, which are listed of"
            " each frame, or null"
        )
    kinds = {name: _extractor(settings).node_type for name, settings in descriptors.items()}
    members: dict[str, Any] = {}
    for kernel_name, settings in kernels.items():
        choices = []
        for node_type in node_types(_kernel(settings)):
            fitting = [name for name, kind in kinds.items() if kind is node_type]
            if not fitting:
                described = ", ".join(f"{name} describes a {kind}" for name, kind in kinds.items())
                raise InputError(
                    f"kernel={kernel_name} joins a {node_type}, and {described}; expected a descriptor of a"
                    f" {node_type} too (several are given as descriptor=[orb,lbd])"
                )
            choices.append([(str(node_type), name) for name in fitting])
        for choice in product(*choices):
            name = "_".join([kernel_name, *(extractor for _, extractor in choice)])
            members[name] = {"kernel": dict(settings), "extractors": dict(choice)}
    used = {name for member in members.values() for name in member["extractors"].values()}
    return {
        "format": FORMAT,
        "extractors": {name: dict(settings) for name, settings in descriptors.items() if name in used},
        "members": members,
        "model": dict(model),
        "features": dict(features),
        "alternatives": alternatives,
    }


def build(description: Mapping[str, Any], cache: FeatureCache | None = None, seed: int = 0) -> SkillComponents:
    """The objects of a description; the networks have fresh weights.

    These depend on the seed and the member's name, not on what other members there are or on what was drawn before.
    PyTorch's own generator is left as it was.

    Raises:
        InputError: when the description is of another format or names anything outside this package.
        KeyError, TypeError: when it lacks a part.
    """
    if description.get("format") != FORMAT:
        raise InputError(f"the skill's format is {description.get('format')!r}; expected {FORMAT}")
    pipelines = {
        name: FeaturePipeline(_extractor(settings), cache=cache, **description["features"])
        for name, settings in description["extractors"].items()
    }
    members = {}
    for name, settings in description["members"].items():
        kernel = _kernel(settings["kernel"])
        extractors = {NodeType(kind): extractor for kind, extractor in settings["extractors"].items()}
        dims = {kind: pipelines[extractor].descriptor_dim for kind, extractor in extractors.items()}
        sides = {kind: pipelines[extractor].patch_side for kind, extractor in extractors.items()}
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(zlib.crc32(f"{seed} {name}".encode()))
            scorer: InstanceScorer = _part(description["model"], InstanceScorer)(Motif.of(kernel, dims, sides))
        members[name] = KernelModel(kernel, extractors, scorer)
    return SkillComponents(members, pipelines, int(description["alternatives"]), description.get("learned_from", {}))


def _extractor(settings: Mapping[str, Any]) -> FeatureExtractor:
    extractor: FeatureExtractor = _complete(settings, FeatureExtractor)
    return extractor


def _kernel(settings: Mapping[str, Any]) -> Kernel:
    kernel: Kernel = _complete(settings, Kernel)
    return kernel


def _complete(settings: Mapping[str, Any], kind: type) -> Any:
    try:
        return _part(settings, kind)()
    except TypeError as error:
        raise InputError(f"{settings['_target_']}: {error}") from error


def _part(settings: Mapping[str, Any], kind: type) -> Callable[..., Any]:
    """The class that a part names, with the part's arguments.

    Not Hydra's ``instantiate``, which finds whatever a module of this package has imported, also ``os.system``, and
    builds what the arguments name too: a checkpoint from elsewhere must not be able to call what it likes.
    """
    target = str(settings.get("_target_"))
    module, _, name = target.rpartition(".")
    found = None
    if module.startswith("geoskill."):
        with suppress(ImportError):
            found = getattr(import_module(module), name, None)
    if not (isinstance(found, type) and issubclass(found, kind) and found.__module__ == module):
        raise InputError(f"the skill's part {target!r} is no {kind.__name__} of this package; expected geoskill.…")
    return partial(found, **{key: value for key, value in settings.items() if key not in ("_target_", "_partial_")})
