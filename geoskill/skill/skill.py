"""A learned skill: load it, and ask it which features of a frame belong together."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, final

import numpy as np
import torch
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.graphs.motif_graph import motif_graph
from geoskill.model.kernel_model import KernelModel
from geoskill.model.message_passing import MessagePassing
from geoskill.skill.association import InferenceResult
from geoskill.skill.scored_frame import ScoredFrame, ScoredInstances
from geoskill.skill.spec import SkillComponents, build


@final
class Skill:
    """The members of a learned skill with the extractors that feed them.

    Args:
        parts: members with trained weights, extractors, and how many associations per member are listed.
    """

    def __init__(self, parts: SkillComponents) -> None:
        self.members: Mapping[str, KernelModel] = parts.members
        self.pipelines: Mapping[str, FeaturePipeline] = parts.pipelines
        self.alternatives = parts.alternatives
        self.learned_from = parts.learned_from
        for member in self.members.values():
            member.eval()

    @classmethod
    def load(
        cls, path: str | Path, *, device: str = "cpu", cache: FeatureCache | None = None, precision: str | None = None
    ) -> "Skill":
        """The skill of a checkpoint.

        Args:
            path: ``skill.ckpt`` of a run.
            device: where the networks run.
            cache: where extracted features are kept, or None.
            precision: of the messages, ``float32`` or ``bfloat16``, in place of the one that it was trained with.

        Raises:
            InputError: when the file is missing, is no checkpoint of a skill, its weights do not fit, there is no such
                device, or its network has no such precision.
        """
        checkpoint = read_checkpoint(path)
        try:
            parts = build(checkpoint["skill"], cache)
            for name, member in parts.members.items():
                prefix = f"members.{name}."
                weights = {
                    key.removeprefix(prefix): value
                    for key, value in checkpoint["state_dict"].items()
                    if key.startswith(prefix)
                }
                member.load_state_dict(weights)
                if precision is not None:
                    _use_precision(member, precision)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        except Exception as error:
            message = " ".join(str(error).split())
            raise InputError(f"{path}: its weights do not fit its description ({message[:200]})") from error
        try:
            for member in parts.members.values():
                member.to(device)
        except (RuntimeError, AssertionError) as error:  # PyTorch asserts that it was built for the device
            raise InputError(f"device={device}: {str(error).splitlines()[0]} (expected one such as cpu)") from error
        return cls(parts)

    def infer(
        self, frame: UInt8[np.ndarray, "height width 3"], features: Mapping[str, FeatureSet] | None = None
    ) -> InferenceResult:
        """The associations that define the task in one RGB frame, whatever frames came before.

        Args:
            frame: the picture.
            features: what :meth:`extract` found in it, when that has been done.

        Raises:
            InputError: when the frame is not ``[H, W, 3]`` of uint8, or has no pixel.
        """
        observation = self.observe(frame, features)
        return observation.result(
            {name: scored.associations(scored.best(self.alternatives)) for name, scored in observation.members.items()}
        )

    def extract(self, frame: UInt8[np.ndarray, "height width 3"]) -> dict[str, FeatureSet]:
        """What each extractor finds in one RGB frame, by the extractor's name; of several frames at once if wanted.

        Raises:
            InputError: when the frame is not ``[H, W, 3]`` of uint8, or has no pixel.
        """
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.dtype != np.uint8 or frame.size == 0:
            raise InputError(f"the frame is {frame.dtype} {list(frame.shape)}; expected uint8 [height, width, 3], RGB")
        return {name: pipeline.extract(frame) for name, pipeline in self.pipelines.items()}

    @torch.no_grad()
    def observe(
        self, frame: UInt8[np.ndarray, "height width 3"], features: Mapping[str, FeatureSet] | None = None
    ) -> ScoredFrame:
        """The scores of all instances in one RGB frame; the arguments and errors are those of :meth:`infer`."""
        features = self.extract(frame) if features is None else features
        members = {}
        for name, member in self.members.items():
            graph = motif_graph(member.kernel, {kind: features[name] for kind, name in member.extractors.items()})
            graph = graph.to(next(member.parameters()).device)
            scores = member(graph) if graph.instance_index.shape[1] else torch.zeros(0)
            members[name] = ScoredInstances(name, member, graph, scores, torch.softmax(scores, dim=0))
        return ScoredFrame(features, members)


def _use_precision(member: KernelModel, precision: str) -> None:
    scorer = member.scorer
    if isinstance(scorer, MessagePassing):
        scorer.use_precision(precision)
    elif precision != "float32":
        raise InputError(f"precision={precision}: {type(scorer).__name__} passes no messages; expected float32 or null")


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """A checkpoint's plain values and tensors; nothing in it is executed.

    Raises:
        InputError: when the file is missing or is no checkpoint of a skill.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file; expected the skill.ckpt of a training run")
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a broken archive raises anything from EOFError to UnpicklingError
        raise InputError(
            f"{path}: cannot be read as a checkpoint; expected the skill.ckpt of a training run"
        ) from error
    if not isinstance(checkpoint, dict) or not {"skill", "state_dict"} <= checkpoint.keys():
        raise InputError(f"{path}: is no skill of this program; expected the skill.ckpt of a training run")
    return checkpoint
