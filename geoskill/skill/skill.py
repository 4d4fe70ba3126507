"""A learned skill: load it, and ask it which features of a frame belong together."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import final

import numpy as np
import torch
from jaxtyping import UInt8

from geoskill.control.decidability import Decidability
from geoskill.control.sequence import Phase
from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.graphs.motif_graph import motif_graph
from geoskill.io.frames import EXPECTED_DEPTH, size_text
from geoskill.model.evidence import Evidence
from geoskill.model.kernel_model import KernelModel
from geoskill.model.message_passing import MessagePassing
from geoskill.skill.association import InferenceResult
from geoskill.skill.build import SkillComponents, build_skill
from geoskill.skill.checkpoint import MAX_MESSAGE, Provenance, StoredSkill, read_skill, skill_entry, write_checkpoint
from geoskill.skill.decidable import decidability_of
from geoskill.skill.definition_edit import DEFINITION, read_edit
from geoskill.skill.phases import phases_of
from geoskill.skill.pin import Pin
from geoskill.skill.scored_frame import ScoredFrame, ScoredInstances
from geoskill.skill.spec import SkillSpec
from geoskill.skill.weights import require_fit


@final
class Skill:
    """The members of a learned skill with the feature pipelines that feed them.

    Args:
        components: members with trained weights, and feature pipelines.
        spec: what they were built from.
        provenance: where the weights come from.
        pins: pinned associations by the member's name (:mod:`geoskill.skill.definition_edit`).
    """

    def __init__(
        self,
        components: SkillComponents,
        spec: SkillSpec,
        provenance: Provenance,
        pins: Mapping[str, Pin] | None = None,
    ) -> None:
        self.members: Mapping[str, KernelModel] = components.members
        self.pipelines: Mapping[str, FeaturePipeline] = components.pipelines
        self.spec = spec
        self.provenance = provenance
        self.pins: Mapping[str, Pin] = {} if pins is None else pins
        for member in self.members.values():
            member.eval()

    @property
    def top_k(self) -> int:
        """Associations listed per frame and member."""
        return self.spec.top_k

    @property
    def evidence(self) -> dict[str, Evidence]:
        """What the demonstration says of each member, by its name; of an unfinished training nothing."""
        return {name: member.evidence for name, member in self.members.items() if member.evidence is not None}

    @property
    def phases(self) -> tuple[Phase, ...]:
        """The phases of the task in their order, as the demonstration has them."""
        return phases_of(self.members)

    def __repr__(self) -> str:
        origin = self.provenance
        state = "" if origin.finished else f", unfinished: {origin.epochs[0]} of {origin.epochs[1]} epochs"
        width, height = origin.image_size
        shown = {name: value for name, value in origin.metrics.items() if not name.endswith("_epoch")}  # said once
        metrics = ", ".join(f"{name} {value:.3g}" for name, value in shown.items())
        return (
            f"Skill({', '.join(self.members)}; learned from {', '.join(origin.sources)} at {width}x{height},"
            f" {origin.date}, geoskill {origin.version}, seed {origin.seed}{state}{'; ' + metrics if metrics else ''})"
        )

    @classmethod
    def load(
        cls,
        reference: str | Path,
        *,
        device: str = "cpu",
        cache: FeatureCache | None = None,
        precision: str | None = None,
        definition: str | Path | None = None,
    ) -> "Skill":
        """Load the skill of a checkpoint.

        An unfinished training is loaded with a warning: its confidence is not calibrated.

        Args:
            reference: ``skill.ckpt`` of a run, the run's folder, or ``wandb:ENTITY/PROJECT/NAME:ALIAS``.
            device: where the networks run.
            cache: where extracted features are kept, or None.
            precision: of the messages, ``float32`` or ``bfloat16``, in place of the one that it was trained with.
            definition: an edited copy of the run's ``skill.yaml`` that the skill obeys, or None.

        Raises:
            InputError: when the file is missing, is no checkpoint of a skill, needs a package that is not installed,
                its weights do not fit, there is no such device, or its network has no such precision; and when the
                definition has an edit that cannot be made.
        """
        stored = read_skill(reference)
        components, spec, pins = build_stored(stored, cache), stored.spec, None
        if definition is not None:
            edit = read_edit(definition, components, stored.path.with_name(DEFINITION))
            components, spec = edit.applied(components, spec)
            pins = edit.pins
        if not stored.provenance.finished:
            done, wanted = stored.provenance.epochs
            warnings.warn(
                f"{stored.path} is unfinished ({done} of {wanted} epochs): its confidence is not calibrated; go on with"
                f" ckpt_path={stored.path}",
                stacklevel=2,
            )
        for member in components.members.values():
            if precision is not None:
                _use_precision(member, precision)
            try:
                member.to(device)
            except (RuntimeError, AssertionError) as error:  # PyTorch asserts that it was built for the device
                raise InputError(f"device={device}: {str(error).splitlines()[0]} (expected one such as cpu)") from error
        return cls(components, spec, stored.provenance, pins)

    def save(self, path: str | Path) -> None:
        """Write the skill as a checkpoint that can be loaded, but not trained further.

        Raises:
            InputError: when an association is pinned, which no checkpoint says.
        """
        if self.pins:
            raise InputError(
                f"the skill has pinned associations, of {', '.join(self.pins)}; expected one loaded without definition"
            )
        weights = torch.nn.ModuleDict(dict(self.members)).state_dict(prefix="members.")
        write_checkpoint(
            path, {"skill": skill_entry(self.spec, self.provenance, self.pipelines), "state_dict": dict(weights)}
        )

    def infer(
        self,
        frame: UInt8[np.ndarray, "height width 3"],
        features: Mapping[str, FeatureSet] | None = None,
        depth: DepthPicture | None = None,
    ) -> InferenceResult:
        """Select the associations that define the task in one RGB frame, whatever frames came before.

        Args:
            frame: the picture.
            features: what :meth:`extract` found in it, when that has been done.
            depth: of the picture, which members in space need.

        Raises:
            InputError: when the frame is not ``[H, W, 3]`` of uint8 or has no pixel, or its depth is needed and not
                given, or of another size.
        """
        scored_frame = self.observe(frame, features, depth)
        return scored_frame.result(
            {name: scored.associations(scored.best(self.top_k)) for name, scored in scored_frame.members.items()}
        )

    def decidability(self, result: InferenceResult, image_size: tuple[int, int] | None = None) -> Decidability | None:
        """Return what the associations of a frame determine and what they leave free; None without associations.

        Args:
            result: of the frame.
            image_size: width and height, pixels; None for those of the demonstration.
        """
        kernels = {name: member.kernel for name, member in self.members.items()}
        return decidability_of(kernels, result, image_size or self.provenance.image_size)

    def extract(
        self, frame: UInt8[np.ndarray, "height width 3"], depth: DepthPicture | None = None
    ) -> dict[str, FeatureSet]:
        """Extract the features of one RGB frame, by the extractor's name; safe to call from several threads.

        The arguments and errors are those of :meth:`infer`.
        """
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or frame.size == 0:
            raise InputError(f"the frame is {frame.dtype} {list(frame.shape)}; expected uint8 [height, width, 3], RGB")
        if depth is None:
            self.require_depth("the frame")
        elif depth.depth_m.shape != frame.shape[:2]:
            raise InputError(
                f"the depth is {size_text(depth.depth_m.shape)} pixels; expected {size_text(frame.shape)}, as the frame"
            )
        return {name: pipeline.extract(frame, depth) for name, pipeline in self.pipelines.items()}

    def require_depth(self, name: str) -> None:
        """Raise InputError if there is a member in space, for what has no depth.

        Args:
            name: of that.
        """
        for member in self.members.values():
            if member.kernel.in_space:
                raise InputError(f"kernel={member.kernel.name} needs depth, and {name} has none; {EXPECTED_DEPTH}")

    @torch.inference_mode()
    def observe(
        self,
        frame: UInt8[np.ndarray, "height width 3"],
        features: Mapping[str, FeatureSet] | None = None,
        depth: DepthPicture | None = None,
    ) -> ScoredFrame:
        """Score all instances in one RGB frame; the arguments and errors are those of :meth:`infer`."""
        features = self.extract(frame, depth) if features is None else features
        members = {}
        for name, member in self.members.items():
            graph = motif_graph(member.kernel, {kind: features[name] for kind, name in member.extractors.items()})
            graph = graph.to(next(member.parameters()).device)
            scores = member(graph) if graph.instance_index.shape[1] else torch.zeros(0)
            camera = None if depth is None else depth.camera
            allowed = self.pins[name].allows(member.kernel, graph) if name in self.pins else None
            select_out = torch.softmax(scores, dim=0)
            members[name] = ScoredInstances(name, member, graph, scores, select_out, camera, allowed)
        return ScoredFrame(features, members)


def build_stored(stored: StoredSkill, cache: FeatureCache | None = None) -> SkillComponents:
    """Build the members of a checkpoint with its weights.

    Raises:
        InputError: when a part is not installed here, or the weights do not fit.
    """
    try:
        require_fit(stored.spec, stored.weights)
        components = build_skill(stored.spec, cache)
        for name, member in components.members.items():
            member.load_state_dict(dict(stored.weights[name]))
        for name, preference in stored.preferences.items():
            components.pipelines[name] = components.pipelines[name].preferring(preference)
    except InputError as error:
        raise InputError(f"{stored.path}: {str(error)[:MAX_MESSAGE]}") from error
    except Exception as error:
        message = " ".join(str(error).split())
        raise InputError(f"{stored.path}: its weights do not fit its specification ({message[:200]})") from error
    return components


def _use_precision(member: KernelModel, precision: str) -> None:
    scorer = member.scorer
    if isinstance(scorer, MessagePassing):
        scorer.use_precision(precision)
    elif precision != "float32":
        raise InputError(f"precision={precision}: {type(scorer).__name__} passes no messages; expected float32 or null")
