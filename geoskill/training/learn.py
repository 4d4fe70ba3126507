"""Learning a skill from demonstrations, in one call.

::

    demonstrations -> prepare -> fit statistics -> train -> calibrate -> LearnedSkill
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import torch
from lightning import Trainer

from geoskill.config import TrainConfig
from geoskill.data.datamodule import TransitionData
from geoskill.data.demonstrations import Demonstrations
from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.io.prefetch import Progress
from geoskill.schema import as_plain
from geoskill.skill.build import SkillComponents, build_skill
from geoskill.skill.checkpoint import SimulatedScene, StoredSkill, read_skill, skill_entry, write_checkpoint
from geoskill.skill.choice import is_auto, only, plan_candidates
from geoskill.skill.plan import plan_skill
from geoskill.skill.skill import Skill, build_stored
from geoskill.skill.spec import SkillSpec
from geoskill.skill.weights import require_finite
from geoskill.training.calibration import calibrate
from geoskill.training.callbacks import MetricsTable, SkillRecord
from geoskill.training.choice import choose
from geoskill.training.divergence import DivergenceGuard
from geoskill.training.module import SkillTraining
from geoskill.training.prepare import DEMONSTRATIONS, Source, as_sources, prepare
from geoskill.training.quiet import quiet_libraries
from geoskill.training.resume import initialize, is_complete, require_same_run, require_same_spans
from geoskill.training.statistics import fit_statistics
from geoskill.training.trainer import build_optimizer, build_trainer, require_usable, use_threads

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger


@final
class TrainingInterruptedError(KeyboardInterrupt):
    """Ctrl-C or SIGTERM in the middle of training; the checkpoint of the last epoch is complete.

    Attributes:
        epochs: that are in the checkpoint.
    """

    def __init__(self, epochs: int) -> None:
        super().__init__(f"interrupted after {epochs} epochs")
        self.epochs = epochs


@final
@dataclass(frozen=True, eq=False)
class LearnedSkill:
    """The result of a training.

    Attributes:
        skill: ready to infer with.
        metrics: of the last epoch and step, such as ``objective``, ``rsw`` and ``steps``.
        curves: one row for each step.
        is_main: whether this is the first of several processes.
    """

    skill: Skill
    metrics: Mapping[str, float]
    curves: Sequence[Mapping[str, float]]
    is_main: bool = True

    def save(self, path: str | Path) -> None:
        """Write the skill; see :meth:`Skill.save`."""
        self.skill.save(path)


def learn(
    config: TrainConfig | None = None,
    demonstrations: Source | Iterable[Source] = (),
    *,
    checkpoint: str | Path | None = None,
    resume: str | Path | None = None,
    init_from: str | Path | None = None,
    curves: str | Path | None = None,
    logger: "Logger | Sequence[Logger]" = (),
    cache: FeatureCache | None = None,
    progress: Progress | None = None,
    report: Callable[[str], None] | None = None,
    scene: SimulatedScene | None = None,
    count: int | None = None,
) -> LearnedSkill:
    """Learn a skill from one demonstration, or from several.

    Nothing is printed, and nothing written but what ``checkpoint``, ``curves``, ``logger`` and ``cache`` name.

    Args:
        config: what is learned and how; None for the defaults.
        demonstrations: paths of videos or folders of images, frame sources, or arrays of RGB pictures ``[T, H, W, 3]``.
            Several are read one after the other.
        checkpoint: file that is replaced after every epoch; from it an interrupted training goes on.
        resume: checkpoint of such a training, with the same demonstrations and configuration.
        init_from: skill whose network to start from, on other demonstrations.
        curves: CSV file with the curves, replaced after every epoch.
        logger: one of Lightning's, or several.
        cache: where extracted features are kept, or None.
        progress: shows progress over a sequence, or None.
        report: takes a line after every epoch, or None.
        scene: the simulated scene that the demonstrations show; it is kept in the checkpoint.
        count: how many demonstrations there are, where only iterating would tell.

    Raises:
        InputError: for whatever the configuration, a checkpoint or a demonstration has wrong, and when training
            diverges; ``checkpoint`` is then the one of the last epoch before.
        TrainingInterruptedError: after Ctrl-C.
    """
    config = TrainConfig() if config is None else config
    auto = is_auto(config.kernel)
    spec = _plan(config, auto)
    sources = as_sources(demonstrations)
    count = len(sources) if isinstance(sources, Sequence) else count
    if count == 0:
        raise InputError(f"no demonstration; expected {DEMONSTRATIONS}")
    stored = None if resume is None else read_skill(resume)
    if stored is not None:
        if init_from is not None:
            raise InputError(f"init_from={init_from}: expected none, as the training of {resume} goes on")
        spec = _of_the_same_kernels(spec, stored, auto)
        require_same_run(stored, spec, config, scene, count or len(stored.provenance.sources))
    initial = None if init_from is None else read_skill(init_from)
    if initial is not None:
        spec = _of_the_same_kernels(spec, initial, auto)
    known = stored or initial
    components = build_skill(spec, cache, config.seed)
    if initial is not None:
        initialize(components.members, spec, initial)
    with quiet_libraries(), use_threads(config.threads):
        require_usable(config.trainer)
        undecided = auto and known is None
        demonstration, provenance = prepare(config, sources, components, progress, scene, every_member=not undecided)
        if undecided:
            choice = choose(components.members, demonstration)
            spec = only(spec, choice.kept)
            components = components.only(spec)
            demonstration.keep(choice.kept)
            provenance = replace(provenance, choice=choice)
        elif known is not None and (auto or stored is not None):
            provenance = replace(provenance, choice=known.provenance.choice)
        if stored is not None:
            require_same_spans(stored, demonstration.spans)
            provenance = replace(provenance, date=stored.provenance.date)
            if is_complete(stored, config):
                return _finish(stored, demonstration, cache, checkpoint, curves, config.trainer.max_epochs)
        fit_statistics(
            components.members,
            demonstration,
            config.objective,
            config.demonstration.descriptor_noise,
            keep_prototypes=init_from is not None,
        )
        record = SkillRecord(spec, provenance, components.pipelines, demonstration)
        guard, table = DivergenceGuard(), MetricsTable(None if curves is None else Path(curves))
        trainer = build_trainer(
            config,
            guard,
            table,
            record,
            None if checkpoint is None else Path(checkpoint),
            list(logger) if isinstance(logger, Sequence) else [logger],
            progress_bar=progress is not None,
            report=report,
        )
        _fit(trainer, guard, config, components, demonstration, None if stored is None else stored.path)
    metrics = {name: float(value) for name, value in trainer.callback_metrics.items() if not name.endswith("_step")}
    metrics["steps"] = float(trainer.global_step)
    skill = Skill(components, spec, record.provenance)
    return LearnedSkill(skill, metrics, table.rows, trainer.is_global_zero)


def _plan(config: TrainConfig, auto: bool) -> SkillSpec:
    plan = config.descriptor, config.model, config.features, config.inference.top_k
    return plan_candidates(*plan) if auto else plan_skill(config.kernel, *plan)


def _of_the_same_kernels(spec: SkillSpec, stored: StoredSkill, auto: bool) -> SkillSpec:
    """Return a specification of candidates with those members only that a skill has, to go on with these."""
    return only(spec, tuple(stored.spec.members)) if auto and set(spec.members) >= set(stored.spec.members) else spec


def _fit(
    trainer: Trainer,
    guard: DivergenceGuard,
    config: TrainConfig,
    components: SkillComponents,
    demonstration: Demonstrations,
    resume: Path | None,
) -> None:
    """Train the members, from the beginning or from a checkpoint.

    Raises:
        InputError: when the training diverges, or does not begin with the state of the checkpoint.
        TrainingInterruptedError: after Ctrl-C.
    """
    module = SkillTraining(
        components.members,
        config.objective,
        build_optimizer(config.optimizer),
        descriptor_noise=config.demonstration.descriptor_noise,
        feature_dropout=config.demonstration.feature_dropout,
        max_visible_features=config.demonstration.max_visible_features,
        seed=config.seed,
    )
    for logger in trainer.loggers:
        logger.log_hyperparams(as_plain(config))
    data = TransitionData(demonstration, batch_size=config.demonstration.batch_size, seed=config.seed)
    try:
        trainer.fit(module, datamodule=data, ckpt_path=resume, weights_only=True)
    except (SystemExit, KeyboardInterrupt) as interruption:  # Lightning turns Ctrl-C into the end of the program
        if trainer.interrupted and trainer.is_global_zero:
            raise TrainingInterruptedError(trainer.current_epoch) from interruption
        raise
    except (InputError, OSError):
        raise
    except Exception as error:
        if resume is None or guard.steps > 1:  # what Lightning reads of the state, it uses within a step
            raise
        message = " ".join(str(error).split())[:200]
        raise InputError(
            f"{resume}: the state of its training cannot be used ({type(error).__name__}: {message});"
            " expected that of an interrupted training (init_from= starts from its weights)"
        ) from error


def _finish(
    stored: StoredSkill,
    demonstration: Demonstrations,
    cache: FeatureCache | None,
    checkpoint: str | Path | None,
    curves: str | Path | None,
    epochs: int,
) -> LearnedSkill:
    """Return the skill of a checkpoint that has all of its epochs, calibrated if it was not."""
    components = build_stored(stored, cache)
    provenance = stored.provenance
    contents: dict[str, Any] = dict(stored.contents)
    if not provenance.finished:
        calibrate(components.members, demonstration)
        provenance = replace(provenance, finished=True, epochs=(provenance.epochs[0], epochs))
        weights = torch.nn.ModuleDict(dict(components.members)).state_dict(prefix="members.")
        require_finite(weights)
        contents |= {"skill": skill_entry(stored.spec, provenance, components.pipelines), "state_dict": weights}
    if checkpoint is not None:
        write_checkpoint(checkpoint, contents)
    table = MetricsTable(None if curves is None else Path(curves))
    states: Mapping[str, Any] = contents["callbacks"]
    table.load_state_dict(states.get(table.state_key, {"rows": []}))
    table.write()
    last = {name: value for name, value in (table.rows[-1] if table.rows else {}).items() if "/" in name}
    metrics = {**provenance.metrics, **last, "steps": float(contents["global_step"])}
    return LearnedSkill(Skill(components, stored.spec, provenance), metrics, table.rows)
