"""Every YAML file under ``conf/`` is a test case."""

from collections.abc import Iterator
from dataclasses import fields
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import ConfigCompositionException
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import configuration_folder
from geoskill.features.extractor import FeatureExtractor
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.objective.inmaxent import ObjectiveSettings
from geoskill.simulation.conditions import Conditions
from geoskill.simulation.tasks.task import Task

CONF = Path(configuration_folder())
COMMANDS = sorted(path.stem for path in CONF.glob("*.yaml") if path.stem != "cache")
GROUPS = sorted(path.name for path in CONF.iterdir() if path.is_dir())
OPTIONS = [(group, path.stem) for group in GROUPS for path in sorted((CONF / group).glob("*.yaml"))]
EXPERIMENTS = [name for group, name in OPTIONS if group == "experiment"]
ARTIFACTS = [name for group, name in OPTIONS if group == "artifact"]
SIMULATED = [name for group, name in OPTIONS if group == "task" and name != "video"]
# What a skill is learned from is also what it is scored on, and both are what is timed.
SHARED = {
    **{group: ["evaluate", "pipeline", "train"] for group in ("task", "scenario")},
    **{group: ["pipeline", "train"] for group in ("kernel", "descriptor", "model")},
}


def options(group: str) -> list[str]:
    return [name for other, name in OPTIONS if other == group]


@pytest.fixture(autouse=True)
def _hydra() -> Iterator[None]:
    with initialize_config_dir(str(CONF), version_base="1.3"):
        yield


def defaults(command: str) -> dict[str, Any]:
    """The options that a command takes of each group, by the group's name."""
    listed = yaml.safe_load((CONF / f"{command}.yaml").read_text())["defaults"]
    return {group: choice for entry in listed if isinstance(entry, dict) for group, choice in entry.items()}


def commands_of(group: str) -> list[str]:
    """The commands whose configuration has this group."""
    return [name for name in COMMANDS if group in defaults(name)]


def parts(node: DictConfig) -> Iterator[tuple[str, Any]]:
    """Every node of a configuration, itself first, by its dotted name."""
    yield "", node
    for key in node:
        if isinstance(node._get_node(key), DictConfig) and node[key] is not None:
            for name, part in parts(node[key]):
                yield f"{key}.{name}".rstrip("."), part


def test_there_is_something_to_test() -> None:
    assert {"train", "infer", "evaluate"} <= set(COMMANDS)
    expected = {"kernel", "descriptor", "model", "objective", "task", "scenario", "trainer", "logger", "experiment"}
    assert expected | {"artifact"} <= set(GROUPS)
    assert {"sorting", "insertion", "folding", "screw"} <= set(SIMULATED)


@pytest.mark.parametrize("path", sorted(CONF.rglob("*.yaml")), ids=lambda path: str(path.relative_to(CONF)))
def test_every_file_says_something(path: Path) -> None:
    assert yaml.safe_load(path.read_text()) is not None


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_compose_and_refuse_unknown_keys_everywhere(command: str) -> None:
    cfg = compose(command)
    OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
    assert cfg.debug is False
    assert all(OmegaConf.is_struct(node) for _, node in parts(cfg))
    last = max((name for name, _ in parts(cfg)), key=lambda name: name.count("."))
    for key in ("no_such_key", f"{last}.no_such_key".lstrip(".")):
        with pytest.raises(ConfigCompositionException, match="Could not override"):
            compose(command, [f"{key}=1"])


@pytest.mark.parametrize(("group", "name"), OPTIONS)
def test_options_compose(group: str, name: str) -> None:
    for command in commands_of(group):
        cfg = compose(command, [f"{group}={name}"])
        OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
        assert all(OmegaConf.is_struct(node) for _, node in parts(cfg))  # unknown keys are refused


@pytest.mark.parametrize("name", options("kernel"))
def test_kernels(name: str) -> None:
    kernels = {key: instantiate(node) for key, node in compose("train", [f"kernel={name}"]).kernel.items()}
    assert all(isinstance(kernel, Kernel) for kernel in kernels.values())
    assert [kernel.name for kernel in kernels.values()] == list(kernels)
    assert list(kernels) == name.split("_")  # an ensemble is named after its members


@pytest.mark.parametrize("name", options("descriptor"))
def test_descriptors(name: str) -> None:
    extractors = {key: instantiate(node) for key, node in compose("train", [f"descriptor={name}"]).descriptor.items()}
    assert list(extractors) == [name]
    assert isinstance(extractors[name], FeatureExtractor)
    assert extractors[name].name == name


def test_the_usual_descriptors_serve_every_kernel() -> None:
    described = {instantiate(node).node_type for node in compose("train").descriptor.values()}
    for name in options("kernel"):
        for node in compose("train", [f"kernel={name}"]).kernel.values():
            assert set(node_types(instantiate(node))) <= described


@pytest.mark.parametrize("name", options("model"))
def test_models(name: str) -> None:
    build = instantiate(compose("train", [f"model={name}"]).model)
    assert isinstance(build, partial)
    for kernel in options("kernel"):
        for node in compose("train", [f"kernel={kernel}"]).kernel.values():
            motif = Motif.of(instantiate(node), dict.fromkeys(NodeType, 4))
            with torch.device("meta"):  # the paper's network is large
                assert isinstance(build(motif), InstanceScorer)


def test_objectives_and_optimizer() -> None:
    for name in options("objective"):
        # The YAML shows what the code does without it.
        assert instantiate(compose("train", [f"objective={name}"]).objective) == ObjectiveSettings()
    optimizer = instantiate(compose("train").optimizer)([torch.nn.Parameter(torch.zeros(1))])
    assert optimizer.param_groups[0]["lr"] == 3e-3


@pytest.mark.parametrize("name", options("trainer"))
def test_trainers(name: str) -> None:
    from lightning import Trainer

    node = compose("train", [f"trainer={name}"]).trainer
    if node.accelerator == "gpu" and not torch.cuda.is_available():
        pytest.skip("no GPU")
    trainer = instantiate(node, logger=False, enable_checkpointing=False)
    assert isinstance(trainer, Trainer)
    assert (trainer.max_epochs, trainer.world_size) == (node.max_epochs, node.devices)


@pytest.mark.parametrize("name", options("logger"))
def test_loggers(name: str, tmp_path: Path) -> None:
    from lightning.pytorch.loggers import Logger

    for key, node in compose("train", [f"logger={name}"]).logger.items():
        logger = instantiate(node, save_dir=str(tmp_path))
        assert isinstance(logger, Logger)
        assert type(logger).__name__.lower().startswith(str(key))
        assert logger.save_dir == str(tmp_path)
    assert list(tmp_path.iterdir()) == []  # nothing is written, and nobody asked, before training


def test_wandb_is_the_default_and_offline() -> None:
    cfg = compose("train")
    assert list(cfg.logger) == ["wandb"]
    assert cfg.logger.wandb.offline is True


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_combination_of_an_experiment_composes(name: str) -> None:
    cfg = compose("train", [f"experiment={name}"], return_hydra_config=True)
    swept = dict(cfg.hydra.sweeper.params or {})
    parser = OverridesParser.create()
    choices = []
    for key, values in swept.items():
        override = parser.parse_override(f"{key}={values}")
        assert override.is_sweep_override()
        choices.append([f"{key}={value}" for value in override.sweep_string_iterator()])
    for combination in product(*choices):
        job = compose("train", [f"experiment={name}", *combination])
        for setting in combination:
            key, value = setting.split("=")
            assert str(OmegaConf.select(job, key)) == value
        objective = instantiate(job.objective)
        assert isinstance(objective, ObjectiveSettings)
        motif = Motif.of(instantiate(job.kernel.p2p), {NodeType.POINT: 4})
        with torch.device("meta"):
            assert isinstance(instantiate(job.model)(motif), InstanceScorer)
    if name.startswith("ablation_"):
        assert "seed" in swept
        assert len(swept) == 2
        assert cfg.hydra.launcher._target_.endswith("JoblibLauncher")
        assert list(job.logger) == []
        assert job.threads == 1


def test_the_paper_taken_literally() -> None:
    cfg = compose("train", ["experiment=paper"])
    # Section IV-A: message passing over 5 steps with a hidden state of 512, shared weights.
    assert cfg.model._target_ == "geoskill.model.message_passing.MessagePassing"
    assert (cfg.model.hidden_dim, cfg.model.layers, cfg.model.shared_weights) == (512, 5, True)
    assert cfg.model.read_out == "perceptron"
    # Equations 1, 7 and 8, and Algorithm 1.
    assert instantiate(cfg.objective) == ObjectiveSettings(
        sigma0=0.55,
        rsw_weight=0.1,
        top_k=10,
        reward="frame",
        change="absolute",
        error_reduction="vector",
        partition="monte_carlo",
        value_samples=1000,
        gradient_samples=1000,
        goal_weight=0.0,
    )
    # Section IV-A, training and results.
    assert cfg.features.max_features == 60
    assert (cfg.inference.alternatives, cfg.inference.minimum_weight) == (10, 0.1)
    # Of what the paper does not have, nothing: every change of state once an iteration, pictures as they are.
    assert (cfg.trainer.limit_train_batches, cfg.trainer.gradient_clip_val) == (None, None)
    assert cfg.early_stopping.patience is None
    assert cfg.features.min_side == 0
    assert (cfg.demonstration.gap, cfg.demonstration.horizon, cfg.demonstration.batch_size) == (1, 0, 1)
    assert (cfg.demonstration.descriptor_noise, cfg.demonstration.feature_dropout) == (0, 0)
    assert cfg.demonstration.num_negatives == 0


@pytest.mark.parametrize("name", SIMULATED)
def test_simulated_tasks(name: str) -> None:
    train, evaluate = (compose(command, [f"task={name}"]).task for command in ("train", "evaluate"))
    assert train == evaluate
    task = instantiate(train.scene)
    assert isinstance(task, Task)
    assert task.name == name
    assert train.every >= 1


def test_without_a_word_a_skill_is_learned_from_a_person_who_sorts_and_scored_on_a_video() -> None:
    train, evaluate = compose("train", return_hydra_config=True), compose("evaluate", return_hydra_config=True)
    assert (train.hydra.runtime.choices.task, train.hydra.runtime.choices.scenario) == ("sorting", "human")
    assert (evaluate.hydra.runtime.choices.task, evaluate.hydra.runtime.choices.scenario) == (None, "robot")


def test_what_is_timed_is_what_is_learned_by_default() -> None:
    timed, train = compose("pipeline"), compose("train")
    for part in ("kernel", "descriptor", "model", "features"):
        assert timed[part] == train[part]
    assert timed.inference.alternatives == train.inference.alternatives


@pytest.mark.parametrize("name", options("scenario"))
def test_scenarios(name: str) -> None:
    conditions = instantiate(compose("evaluate", [f"scenario={name}"]).scenario)
    assert isinstance(conditions, Conditions)
    difficulties = {field.name for field in fields(Conditions) if field.type is bool}
    assert len(difficulties) == 5
    wanted = difficulties if name == "combined" else {name} & difficulties
    assert {key for key in difficulties if getattr(conditions, key)} == wanted
    assert conditions.actor == ("human" if name == "human" else "robot")
    assert name in difficulties | {"human", "robot", "combined"}
    # What the YAML does not change is what the code does without it.
    assert (conditions.severity, conditions.confidence) == (
        Conditions("robot").severity,
        Conditions("robot").confidence,
    )


@pytest.mark.parametrize("name", ARTIFACTS)
def test_every_training_and_test_of_an_artifact_composes(name: str) -> None:
    artifact = OmegaConf.to_container(compose("reproduce", [f"artifact={name}"]).artifact, resolve=True)
    assert isinstance(artifact, dict)
    for row, overrides in artifact["rows"].items():
        training = [*artifact["train"], *overrides]
        compose("train", [*training, "trainer.max_epochs=2", "seed=0", "threads=1", "logger=none"])
        learned = [override for override in training if override.startswith("task=") and override != "task=video"]
        for test in artifact["tests"].values():
            compose("evaluate", [*learned[-1:], *test, "every=10"])
        assert set(artifact["published"].get(row, {})) <= set(artifact["tests"])
    assert len(set(artifact["seeds"])) >= 3


@pytest.mark.parametrize("group", GROUPS)
def test_every_group_is_used_by_one_command_or_shared(group: str) -> None:
    commands = commands_of(group)
    assert commands == SHARED.get(group, commands[:1])
    for command in commands:
        choice = defaults(command)[group]
        chosen = [] if choice is None else choice if isinstance(choice, list) else [choice]
        assert set(chosen) <= set(options(group))


def test_every_kernel_descriptor_and_task_in_the_code_has_its_file() -> None:
    import importlib
    import pkgutil

    import geoskill.features
    import geoskill.kernels
    import geoskill.simulation.tasks

    for package, base, group in (
        (geoskill.kernels, Kernel, "kernel"),
        (geoskill.features, FeatureExtractor, "descriptor"),
        (geoskill.simulation.tasks, Task, "task"),
    ):
        for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
        for subclass in base.__subclasses__():
            if not subclass.__module__.startswith("geoskill."):
                continue
            stem = subclass.__module__.rsplit(".", 1)[1]
            assert stem in options(group)
            target = compose("train", [f"{group}={stem}"])[group]["scene" if group == "task" else stem]._target_
            assert target == f"{subclass.__module__}.{subclass.__qualname__}"
