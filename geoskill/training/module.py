"""Training as a Lightning module: maximize the objective of every member of the ensemble."""

import zlib
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any, final

import torch
from lightning import LightningModule
from torch import Tensor, nn
from torch.optim import Optimizer

from geoskill.config import ObjectiveConfig
from geoskill.data.augmentation import noisy, sample_visible
from geoskill.graphs.motif_graph import MotifGraph, take_features, with_instances
from geoskill.model.kernel_model import KernelModel
from geoskill.objective.inmaxent import FrameSelection, ObjectiveValue, transition_objective
from geoskill.objective.selection import select_out
from geoskill.training.calibration import uncalibrated
from geoskill.training.error_changes import error_changes, instance_goal_progress

Batch = Mapping[str, Mapping[str, MotifGraph]]


@final
class SkillTraining(LightningModule):
    """Training of all members of a skill at once.

    Members share batches and the optimizer, but no weights, and their gradients are clipped separately: each member
    of an ensemble learns what it would learn alone. Random numbers depend on the seed, the member and the step only,
    so a resumed training repeats the steps of an unbroken one.

    Args:
        members: by name, with fitted statistics (:func:`~geoskill.training.statistics.fit_statistics`).
        objective: settings of the objective, which is maximized.
        optimizer: makes an optimizer from parameters.
        descriptor_noise: expected norm of the Gaussian noise on a descriptor over the descriptor's norm.
        feature_dropout: probability with which a feature is hidden in a step (:func:`sample_visible`).
        max_visible_features: expected number of visible features per frame and node type, at most; None for all.
        seed: seed of the noise, of hidden features and of Monte-Carlo samples.
    """

    def __init__(
        self,
        members: Mapping[str, KernelModel],
        objective: ObjectiveConfig,
        optimizer: Callable[[Iterable[nn.Parameter]], Optimizer],
        *,
        descriptor_noise: float,
        feature_dropout: float = 0.0,
        max_visible_features: int | None = None,
        seed: int,
    ) -> None:
        super().__init__()
        self.members = nn.ModuleDict(members)
        self.objective = objective
        self.optimizer = optimizer
        self.descriptor_noise = descriptor_noise
        self.feature_dropout = feature_dropout
        self.max_visible_features = max_visible_features
        self.seed = seed

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Forget the calibration of a finished skill whose training goes on; it is fitted anew when that ends."""
        members = {name: own for name, own in self.members.items() if isinstance(own, KernelModel)}
        checkpoint["state_dict"] |= uncalibrated(members, prefix="members.")

    def configure_optimizers(self) -> Optimizer:
        """Return one optimizer for all members; Adam updates every weight by itself, so members do not mix."""
        return self.optimizer(self.parameters())

    def training_step(self, batch: Batch, batch_index: int) -> Tensor:
        """Return minus the sum of the members' objectives on a batch of transitions."""
        values = {name: self._member_objective(name, frames, self._generator(name)) for name, frames in batch.items()}
        # Means over all processes, which have equal shares of a batch.
        log = partial(self.log, batch_size=self._transitions(batch), sync_dist=True)
        for name, value in values.items():
            for quantity in ("objective", "reward", "rsw", "goal", "error"):
                log(f"{name}/{quantity}", getattr(value, quantity))
        total = torch.stack([value.objective for value in values.values()])
        log("objective", total.mean(), prog_bar=True, on_epoch=True)
        rsw = torch.stack([value.rsw for value in values.values()]).mean()
        log("rsw", rsw, prog_bar=True, on_epoch=True, on_step=False)
        return -total.sum()

    def _generator(self, member: str) -> torch.Generator:
        """Return a generator seeded by member, step and process: no two of them share noise."""
        stream = f"{self.seed} {member} {self.global_step} {self.global_rank}"
        return torch.Generator(device=self.device).manual_seed(zlib.crc32(stream.encode()))

    @staticmethod
    def _transitions(batch: Batch) -> int:
        return int(next(iter(batch.values()))["first"].num_graphs)

    def _member_objective(
        self, name: str, frames: Mapping[str, MotifGraph], generator: torch.Generator
    ) -> ObjectiveValue:
        member = self.members[name]
        assert isinstance(member, KernelModel)
        first = self._selection(member, frames["first"], generator)
        second = self._selection(member, frames["second"], generator, backwards=True)
        beta = member.beta[frames["first"].span_index]
        return transition_objective(self.objective, beta, first, second, generator)

    def _selection(
        self, member: KernelModel, graph: MotifGraph, generator: torch.Generator, backwards: bool = False
    ) -> FrameSelection:
        if self.feature_dropout > 0 or self.max_visible_features is not None:
            visible = sample_visible(
                graph, member.node_types, self.feature_dropout, self.max_visible_features, generator
            )
            graph = take_features(graph, visible)
        descriptors = member.attribute(graph, "descriptor")
        if self.descriptor_noise > 0:
            descriptors = {kind: noisy(x, self.descriptor_noise, generator) for kind, x in descriptors.items()}
        graph = with_instances(member.kernel, graph)
        scores, batch, num_frames = member(graph, descriptors), graph.instance_frame, int(graph.num_graphs)
        change = error_changes(member, graph, self.objective.change)
        goal: dict[str, Tensor] = {}
        if self.objective.goal_weight > 0:
            progress = instance_goal_progress(member, graph)
            goal = {"goal_progress": progress, "scores": scores, "by_progress": graph.by_progress}
        return FrameSelection(
            select_out(scores, batch, num_frames),
            member.control_errors(graph),
            -change if backwards else change,
            batch,
            num_frames,
            **goal,
        )

    def configure_gradient_clipping(
        self,
        optimizer: Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip the gradient of each member by itself: its norm, or with the algorithm ``value`` its components."""
        if gradient_clip_val:
            clip = nn.utils.clip_grad_value_ if gradient_clip_algorithm == "value" else nn.utils.clip_grad_norm_
            for member in self.members.values():
                clip(member.parameters(), gradient_clip_val)
