"""A small demonstration, and runs that learn from it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, final

import jaxtyping
import numpy as np
import pytest
import torch
from lightning import Callback, Trainer

from geoskill.config import ObjectiveConfig
from geoskill.data.datamodule import TransitionData
from geoskill.data.demonstration import Demonstration
from geoskill.data.transitions import Transition, Transitions
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.plan import plan_skill
from geoskill.skill.spec import SkillSpec
from geoskill.training.callbacks import MetricsTable, ResumableCheckpoint, SkillRecord
from geoskill.training.error_changes import fit_reward_scale
from geoskill.training.module import SkillTraining
from geoskill.training.quiet import quiet_libraries

ADAM = partial(torch.optim.Adam, lr=3e-3)


def in_silence(items: Sequence[int], description: str) -> Iterable[int]:
    return items


@final
class HandMade(Transitions):
    """Given first frames of transitions, over given spans; a graph's own ``span_index`` says over which."""

    def __init__(self, spans: tuple[int, ...], graphs: Sequence[MotifGraph]) -> None:
        self._spans = spans
        self.graphs = graphs

    @property
    def spans(self) -> tuple[int, ...]:
        return self._spans

    def __len__(self) -> int:
        return len(self.graphs)

    def __getitem__(self, index: int) -> Transition:
        return {"hand made": {"first": self.graphs[index]}}

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        return self.graphs[index]

    def frames(self, name: str) -> Iterator[MotifGraph]:
        return iter(self.graphs)

    def descriptors(self, name: str) -> dict[NodeType, torch.Tensor]:
        kinds = dict.fromkeys(NodeType(role) for graph in self.graphs for role in graph.roles)
        return {kind: torch.cat([graph[f"{kind}_descriptor"] for graph in self.graphs]) for kind in kinds}


class Training:
    """Runs that learn from one demonstration, all from the same weights."""

    def __init__(self, frames: Sequence[np.ndarray], spec: SkillSpec) -> None:
        self.spec = spec
        components = build_skill(spec)
        self.pipelines = components.pipelines
        self.demonstration = Demonstration(
            frames,
            components.pipelines,
            components.members,
            gap=2,
            max_span_ratio=0.6,
            num_negatives=0,
            progress=in_silence,
        )

    def members(self, model: Mapping[str, Any] | None = None) -> dict[str, KernelModel]:
        """Build untrained members, with another network than that of the specification if one is given."""
        spec = self.spec
        if model is not None:
            network = plan_skill("p2p", "sift", model, spec.features, top_k=1).model
            spec = replace(spec, model=network)
        return build_skill(spec, seed=1).members

    def module(
        self,
        members: dict[str, KernelModel] | None = None,
        optimizer: Callable[..., torch.optim.Optimizer] = ADAM,
        descriptor_noise: float = 0.3,
        feature_dropout: float = 0.2,
        **objective: Any,
    ) -> SkillTraining:
        """Build the module of members, their reward scale fitted, with a top_k of 3 in the objective."""
        members = self.members() if members is None else members
        settings = ObjectiveConfig(**{"top_k": 3, **objective})
        fit_reward_scale(members, self.demonstration, settings)
        return SkillTraining(
            members,
            settings,
            optimizer,
            descriptor_noise=descriptor_noise,
            feature_dropout=feature_dropout,
            seed=5,
        )

    def run(
        self,
        module: SkillTraining,
        folder: Path,
        *,
        epochs: int,
        resume: Path | None = None,
        callbacks: Sequence[Callback] = (),
        batch_size: int = 4,
        check_types: bool = False,
        **trainer: Any,
    ) -> MetricsTable:
        """Train, 3 batches an epoch; leaves metrics.csv and skill.ckpt in the folder.

        Checking annotated types at every call would take most of the time, so one test does it for all.
        """
        folder.mkdir(exist_ok=True)
        table = MetricsTable(folder / "metrics.csv")
        provenance = Provenance(("tiles",), (160, 120), date="2026-01-01", version="0", seed=5)
        record = SkillRecord(self.spec, provenance, {}, self.demonstration)
        settings = {
            "accelerator": "cpu",
            "devices": 1,
            "limit_train_batches": 3,
            "gradient_clip_val": 1.0,
            "log_every_n_steps": 1,
            "logger": False,
            "enable_progress_bar": False,
            "enable_model_summary": False,
        }
        with quiet_libraries(), pytest.MonkeyPatch.context() as patch:
            patch.setattr(jaxtyping.config, "jaxtyping_disable", not check_types)
            Trainer(
                **{**settings, **trainer},
                max_epochs=epochs,
                callbacks=[table, *callbacks, record, ResumableCheckpoint(folder / "skill.ckpt")],
                default_root_dir=str(folder),
            ).fit(
                module,
                datamodule=TransitionData(self.demonstration, batch_size=batch_size, seed=5),
                ckpt_path=resume,
                weights_only=True,
            )
        return table


@pytest.fixture(scope="session")
def training_of(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> Callable[..., Training]:
    """Return a function that makes the training of some of the specification's members."""

    @cache
    def make(*names: str) -> Training:
        members = {name: spec.members[name] for name in names}
        return Training(demonstration_frames, replace(spec, members=members))

    return make


@pytest.fixture(scope="session")
def training(training_of: Callable[..., Training], spec: SkillSpec) -> Training:
    """Of both members: 20 frames, spans of 2, 4 and 8, so 18 + 16 + 12 = 46 transitions."""
    return training_of(*spec.members)


@pytest.fixture(scope="session")
def demonstration(training: Training) -> Demonstration:
    return training.demonstration


@pytest.fixture(scope="session")
def hand_made() -> type[HandMade]:
    """Makes transitions of graphs that a test writes down."""
    return HandMade
