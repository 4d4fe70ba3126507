"""Every YAML file under ``conf/``, and every choice that the registries add, is a test case."""

import dataclasses
import inspect
from collections.abc import Iterator
from dataclasses import fields
from itertools import product
from pathlib import Path
from typing import Any, get_type_hints

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import ConfigCompositionException
from omegaconf import DictConfig, OmegaConf

from geoskill.benchmarks.config import BenchmarkConfig, PipelineConfig, WaitingConfig
from geoskill.cli import schemas
from geoskill.cli.compose import compose_training, configuration_folder, register_schemas, typed
from geoskill.cli.schemas import EvaluateCommandConfig, SimulatedTaskConfig, VideoTaskConfig
from geoskill.cli.study import Study
from geoskill.config import AUTO, OptimizerConfig, ScenarioConfig
from geoskill.features.extractor import FeatureExtractor
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import EXTRACTORS, KERNELS, REGISTRIES, SCORERS, TASKS
from geoskill.schema import as_plain
from geoskill.simulation.tasks.task import Task
from geoskill.skill.plan import ONLY_DESCRIPTOR
from geoskill.training.trainer import build_optimizer

SCHEMAS = {**schemas.COMMANDS, "pipeline": PipelineConfig, "benchmark": BenchmarkConfig, "waiting": WaitingConfig}
for _command, _schema in SCHEMAS.items():
    register_schemas(_command, _schema)

CALLBACKS = tuple(
    f"_target_: geoskill.cli.{own}" for own in ("sweep.SweepSummary", "folder_lock.FolderLock", "videos.VideosSummary")
)
CONF = Path(configuration_folder())
COMMANDS = sorted(path.stem for path in CONF.glob("*.yaml"))
REGISTERED = {group: names for group, names in ConfigStore.instance().repo.items() if isinstance(names, dict)}
GROUPS = sorted(
    {path.name for path in CONF.iterdir() if path.is_dir()} | REGISTERED.keys() - {"hydra", "_dummy_empty_config_.yaml"}
)
OPTIONS = [
    (group, name)
    for group in GROUPS
    for name in sorted(
        {path.stem for path in (CONF / group).glob("*.yaml")} | {Path(own).stem for own in REGISTERED.get(group, ())}
    )
]
EXPERIMENTS = [name for group, name in OPTIONS if group == "experiment"]
ARTIFACTS = [name for group, name in OPTIONS if group == "artifact"]
SIMULATED = [name for group, name in OPTIONS if group == "task" and name != "video"]
# What a skill is learned from is also what it is scored on, and both are what is timed.
SHARED = {
    **{group: ["evaluate", "pipeline", "servo", "train"] for group in ("task", "scenario")},
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


def arguments_of(name: str, cfg: Any) -> dict[str, Any]:
    """The arguments that are configured for one name of a group."""
    arguments: dict[str, Any] = as_plain(OmegaConf.to_object(cfg[name]))
    return arguments


def test_groups_and_commands() -> None:
    assert {"train", "infer", "evaluate"} <= set(COMMANDS)
    assert set(SCHEMAS) <= set(COMMANDS)
    expected = {"kernel", "descriptor", "model", "task", "scenario", "trainer", "logger", "experiment"}
    assert expected | {"artifact"} <= set(GROUPS)
    assert {"sorting", "insertion", "folding", "screw", "flush", "ring"} <= set(SIMULATED)
    assert options("model") == ["bilinear", "default", "message_passing", "paper", "prototypes"]
    assert {"sift", "orb", "lbd", "patch"} <= set(options("descriptor"))
    assert {"p2p", "l2l", "p2l", "par", "p2p_l2l"} <= set(options("kernel"))


@pytest.mark.parametrize("path", sorted(CONF.rglob("*.yaml")), ids=lambda path: str(path.relative_to(CONF)))
def test_files_are_not_empty_and_name_no_class_of_this_package(path: Path) -> None:
    text = path.read_text()
    assert yaml.safe_load(text) is not None
    for line in text.splitlines():  # only Hydra's own callbacks are classes
        assert "_target_" not in line or line.strip() in CALLBACKS


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


@pytest.mark.parametrize("command", sorted(SCHEMAS))
def test_commands_without_overrides_have_the_defaults_of_their_schema(command: str) -> None:
    config, untouched = typed(compose(command), SCHEMAS[command]), SCHEMAS[command]()
    chosen = [own.name for own in fields(untouched) if own.name in defaults(command)]
    for own in fields(untouched):
        if own.name not in chosen or own.name == "scenario":
            assert getattr(config, own.name) == getattr(untouched, own.name), own.name


@pytest.mark.slow
@pytest.mark.parametrize(("group", "name"), OPTIONS)
def test_options_compose_into_valid_dataclasses(group: str, name: str) -> None:
    for command in commands_of(group):
        cfg = compose(command, [f"{group}={name}"])
        OmegaConf.to_container(cfg, resolve=True, throw_on_missing=True)
        assert all(OmegaConf.is_struct(node) for _, node in parts(cfg))  # unknown keys are refused
        if command in SCHEMAS:
            assert isinstance(typed(cfg, SCHEMAS[command]), SCHEMAS[command])


NAMED_KERNELS = [name for name in options("kernel") if name != AUTO]


@pytest.mark.parametrize("name", NAMED_KERNELS)
def test_kernels(name: str) -> None:
    configured = compose_training(f"kernel={name}").kernel
    kernels = {key: KERNELS.build(key, as_plain(arguments))() for key, arguments in configured.items()}
    assert all(isinstance(kernel, Kernel) for kernel in kernels.values())
    assert [kernel.name for kernel in kernels.values()] == list(kernels)
    assert list(kernels) == name.split("_")  # an ensemble is named after its members


@pytest.mark.parametrize("name", options("descriptor"))
def test_descriptors_have_the_arguments_of_their_constructor(name: str) -> None:
    cfg = compose("train", [f"descriptor={name}"]).descriptor
    assert list(cfg) == [name]
    schema = OmegaConf.get_type(cfg[name])
    assert schema is not None
    parameters = EXTRACTORS.parameters(name)
    assert arguments_of(name, cfg) == {key: parameter.default for key, parameter in parameters.items()}
    constructor = inspect.unwrap(EXTRACTORS.get(name).__init__)  # type: ignore[misc]
    hints = {key: hint for key, hint in get_type_hints(constructor).items() if key != "return"}
    assert {own.name: own.type for own in dataclasses.fields(schema)} == hints
    extractor = EXTRACTORS.build(name, arguments_of(name, cfg))()
    assert isinstance(extractor, FeatureExtractor)
    assert extractor.name == name
    for key, argument in arguments_of(name, cfg).items():
        assert getattr(extractor, key) == argument


def test_default_descriptors_serve_every_kernel() -> None:
    described = {EXTRACTORS.build(name, {})().node_type for name in compose("train").descriptor}
    for name in NAMED_KERNELS:
        for key in compose_training(f"kernel={name}").kernel:
            assert set(node_types(KERNELS.build(key, {})())) <= described | set(ONLY_DESCRIPTOR)


@pytest.mark.slow
@pytest.mark.parametrize("name", options("model"))
def test_models(name: str) -> None:
    arguments = as_plain(compose_training(f"model={name}").model)
    build = SCORERS.build(arguments.pop("name"), arguments)
    for kernel in NAMED_KERNELS:
        for key in compose_training(f"kernel={kernel}").kernel:
            motif = Motif.of(KERNELS.build(key, {})(), dict.fromkeys(NodeType, 4))
            with torch.device("meta"):  # the paper's network is large
                assert isinstance(build(motif), InstanceScorer)


@pytest.mark.parametrize(("name", "optimizer"), [("adam", "Adam"), ("adamw", "AdamW"), ("sgd", "SGD")])
def test_optimizers(name: str, optimizer: str) -> None:
    config = compose_training(f"optimizer.name={name}", "optimizer.weight_decay=0.5").optimizer
    assert config == OptimizerConfig(name, 3e-3, 0.5)
    built = build_optimizer(config)([torch.nn.Parameter(torch.zeros(1))])
    assert type(built).__name__ == optimizer
    assert (built.param_groups[0]["lr"], built.param_groups[0]["weight_decay"]) == (3e-3, 0.5)


@pytest.mark.parametrize("name", options("trainer"))
def test_trainers(name: str) -> None:
    from lightning import Trainer

    from geoskill.training.quiet import quiet_libraries

    config = compose_training(f"trainer={name}").trainer
    assert (config.accelerator, config.devices) == {"cpu": ("cpu", 1), "ddp": ("cpu", 2), "gpu": ("gpu", 1)}[name]
    if config.accelerator == "gpu" and not torch.cuda.is_available():
        pytest.skip("no GPU")
    with quiet_libraries():  # where there is an srun, Lightning advises it
        trainer = Trainer(**as_plain(config), logger=False, enable_checkpointing=False)
    assert (trainer.max_epochs, trainer.world_size) == (config.max_epochs, config.devices)


@pytest.mark.parametrize("name", options("logger"))
def test_loggers(name: str, tmp_path: Path) -> None:
    from lightning.pytorch.loggers import Logger

    from geoskill.cli.command import Run
    from geoskill.cli.train import _loggers

    loggers = _loggers(compose_training(f"logger={name}"), Run(tmp_path, {}, (), False))
    assert len(loggers) == (name != "none")
    for logger in loggers:
        assert isinstance(logger, Logger)
        assert type(logger).__name__.lower().startswith(name)
        assert logger.save_dir == str(tmp_path)
    assert list(tmp_path.iterdir()) == []  # nothing is written, and nobody asked, before training


def test_wandb_is_the_default_and_offline() -> None:
    cfg = compose("train")
    assert list(cfg.logger) == ["wandb"]
    assert cfg.logger.wandb.offline is True


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_combination_of_an_experiment_composes(name: str) -> None:
    cfg = compose("train", [f"experiment={name}"], return_hydra_config=True)
    swept = dict(cfg.hydra.sweeper.params or {})
    parser = OverridesParser.create()
    choices = []
    for key, values in swept.items():
        override = parser.parse_override(f"{key}={values}")
        assert override.is_sweep_override()
        values = list(override.sweep_string_iterator())
        choices.append([f"{key}={value}" for value in (values[:1] if key == "seed" else values)])
    for combination in product(*choices):
        job = compose("train", [f"experiment={name}", *combination])
        for setting in combination:
            key, value = setting.split("=")
            assert str(OmegaConf.select(job, key)) == value
        config = typed(job, schemas.TrainCommandConfig, combination)
        motif = Motif.of(KERNELS.build("p2p", config.kernel["p2p"])(), {NodeType.POINT: 4})
        arguments = as_plain(config.model)
        with torch.device("meta"):
            assert isinstance(SCORERS.build(arguments.pop("name"), arguments)(motif), InstanceScorer)
    if name.startswith("ablation_"):
        assert "seed" in swept
        assert len(swept) == 2
        assert cfg.hydra.launcher._target_.endswith("JoblibLauncher")
        assert list(job.logger) == []
        assert job.threads == 1


@pytest.mark.parametrize("name", SIMULATED)
def test_simulated_tasks(name: str) -> None:
    train, evaluate = (typed(compose(command, [f"task={name}"]), SCHEMAS[command]) for command in ("train", "evaluate"))
    assert train.task == evaluate.task == SimulatedTaskConfig(name)  # type: ignore[attr-defined]
    task = TASKS.build(name, {})()
    assert isinstance(task, Task)
    assert task.name == name


def test_video_task() -> None:
    assert compose_training("task=video").task == VideoTaskConfig()


def test_defaults_are_a_person_who_sorts_to_learn_from_and_a_video_to_score_on() -> None:
    train, evaluate = compose("train", return_hydra_config=True), compose("evaluate", return_hydra_config=True)
    assert (train.hydra.runtime.choices.task, train.hydra.runtime.choices.scenario) == ("sorting", "human")
    assert (evaluate.hydra.runtime.choices.task, evaluate.hydra.runtime.choices.scenario) == (None, "robot")


def test_pipeline_times_what_is_learned_by_default() -> None:
    timed, train = compose("pipeline"), compose("train")
    for part in ("kernel", "descriptor", "model", "features"):
        assert timed[part] == train[part]
    assert timed.top_k == train.inference.top_k


@pytest.mark.parametrize("name", options("scenario"))
def test_scenarios(name: str) -> None:
    config = typed(compose("evaluate", [f"scenario={name}"]), EvaluateCommandConfig).scenario
    difficulties = {own.name for own in fields(ScenarioConfig) if own.type is bool}
    assert len(difficulties) == 5
    wanted = difficulties if name == "combined" else {name} & difficulties
    assert {key for key in difficulties if getattr(config, key)} == wanted
    assert config.actor == ("human" if name == "human" else "robot")
    assert name in difficulties | {"human", "robot", "combined"}
    # What the YAML does not change is what the code does without it.
    assert (config.severity, config.confidence) == (ScenarioConfig().severity, ScenarioConfig().confidence)


@pytest.mark.slow
@pytest.mark.parametrize("name", ARTIFACTS)
def test_every_training_and_test_set_of_a_study_composes(name: str, tmp_path: Path) -> None:
    for folder in ("human1", "robot1"):
        (tmp_path / folder).mkdir()
    cfg = compose("reproduce", [f"artifact={name}"])
    if "data" in cfg.artifact:
        cfg.artifact.data = str(tmp_path)
    study = Study.from_plain(as_plain(OmegaConf.to_container(cfg.artifact, resolve=True)))
    assert study.name == name
    jobs = study.jobs(tmp_path, quick=True)
    for job in jobs:
        compose("train", list(job.training.overrides))
    for test in jobs[0].tests.values():  # the other variants differ in the skill's path only
        compose("evaluate", list(test.overrides))
    assert all(set(published) <= set(study.test_sets) for published in study.published.values())
    assert len(set(study.seeds)) >= 3


@pytest.mark.parametrize("name", [name for name in EXPERIMENTS if name.startswith("ablation_")])
def test_ablations_are_the_same_as_an_experiment_and_as_a_study(name: str) -> None:
    swept = dict(compose("train", [f"experiment={name}"], return_hydra_config=True).hydra.sweeper.params)
    study = Study.from_plain(
        as_plain(OmegaConf.to_container(compose("reproduce", [f"artifact={name}"]).artifact, resolve=True))
    )
    assert swept.pop("seed").split(",") == [str(seed) for seed in study.seeds]
    [(key, values)] = swept.items()
    assert list(study.variants.values()) == [[f"{key}={value}"] for value in values.split(",")]
    assert list(study.variants) == [f"{key}={value}" for value in values.split(",")]


@pytest.mark.parametrize("group", GROUPS)
def test_every_group_is_used_by_one_command_or_shared(group: str) -> None:
    commands = commands_of(group)
    assert commands == SHARED.get(group, commands[:1])
    for command in commands:
        choice = defaults(command)[group]
        chosen = [] if choice is None else choice if isinstance(choice, list) else [choice]
        assert set(chosen) <= set(options(group))


@pytest.mark.parametrize("registry", REGISTRIES, ids=lambda registry: registry.kind)
def test_every_class_in_the_code_can_be_chosen(registry: Any) -> None:
    import importlib
    import pkgutil

    package = importlib.import_module(registry.base.__module__.rpartition(".")[0])
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        importlib.import_module(module.name)
    own = [cls for cls in registry.base.__subclasses__() if cls.__module__.startswith("geoskill.")]
    assert {cls.name for cls in own} == set(registry.built_in)
    for cls in own:
        assert cls.__module__.rpartition(".")[2] == cls.name
        assert registry.get(cls.name) is cls
        assert cls.name in options(registry.kind)
        chosen = compose("train", [f"{registry.kind}={cls.name}"])[registry.kind]
        assert cls.name in (chosen.get("name"), *chosen)
