"""From the specification of a skill to its objects."""

import zlib
from dataclasses import dataclass
from typing import final

import torch

from geoskill.features.cache import FeatureCache
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import EXTRACTORS, KERNELS, SCORERS
from geoskill.schema import as_plain
from geoskill.skill.spec import SkillSpec


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


def build_skill(spec: SkillSpec, cache: FeatureCache | None = None, seed: int = 0) -> SkillComponents:
    """Build the members of a skill; the networks have fresh weights.

    These depend on the seed and the member's name, not on what other members there are or on what was drawn before.
    PyTorch's own generator is left as it was.

    Raises:
        InputError: when a part is not installed here, or does not take its arguments.
    """
    kernels: dict[str, Kernel] = {name: member.kernel.build(KERNELS) for name, member in spec.members.items()}
    lifted = {
        extractor
        for name, member in spec.members.items()
        if kernels[name].in_space
        for extractor in member.extractors.values()
    }
    pipelines = {
        name: FeaturePipeline(part.build(EXTRACTORS), cache=cache, in_space=name in lifted, **as_plain(spec.features))
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
            scorer: InstanceScorer = spec.model.build(SCORERS, Motif.of(kernel, dims, sides))
        members[name] = KernelModel(kernel, extractors, scorer)
    return SkillComponents(members, pipelines)
