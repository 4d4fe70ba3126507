"""The configuration: defaults, presets, experiments and the reference."""

import ast
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

import geoskill
from geoskill import config as configuration
from geoskill.cli.compose import compose_training
from geoskill.cli.schemas import (
    COMMANDS,
    RENAMED,
    SimulatedTaskConfig,
    TrainCommandConfig,
    VideoTaskConfig,
    WandbConfig,
    markdown_reference,
)
from geoskill.config import (
    MODELS,
    BilinearConfig,
    Config,
    InferenceConfig,
    Learning,
    MessagePassingConfig,
    ObjectiveConfig,
    PrototypesConfig,
    SelectionConfig,
    TrainConfig,
)
from geoskill.errors import InputError
from geoskill.plugins import SCORERS
from geoskill.schema import as_plain, check_value, default_of, flatten, settings_of
from geoskill.skill.plan import plan_skill

SOURCE = Path(geoskill.__path__[0])
SCHEMAS = [
    value
    for value in vars(configuration).values()
    if isinstance(value, type) and issubclass(value, Config) and value not in (Config, Learning)
]


def plan(config: TrainConfig) -> Any:
    return plan_skill(config.kernel, config.descriptor, config.model, config.features, config.inference.top_k)


@pytest.fixture(scope="module")
def composed() -> TrainConfig:
    """The learning part of what ``train.py`` composes without any override."""
    return compose_training().learning()


def test_default_training_is_the_same_in_python_and_on_the_command_line(composed: TrainConfig) -> None:
    default = TrainConfig()
    for own in fields(TrainConfig):
        # The command line has names with arguments where Python may give names alone.
        if own.name not in ("kernel", "descriptor"):
            assert getattr(composed, own.name) == getattr(default, own.name), own.name
    assert plan(composed) == plan(default)
    assert list(composed.kernel) == [default.kernel]
    assert list(composed.descriptor) == default.descriptor


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.__name__)
def test_defaults_are_in_their_own_range_and_documented(schema: type[Config]) -> None:
    schema()
    for key, own, hint in flatten(schema):
        check_value(key, default_of(own), own, hint)
        assert own.metadata["help"][-1] in ".:", key
        assert "|" not in own.metadata["help"], key  # which would break the table of the reference
    assert schema.__doc__


def test_networks_have_the_arguments_of_their_configuration() -> None:
    assert set(MODELS) == set(SCORERS.built_in)
    for name, schema in MODELS.items():
        assert default_of(next(own for key, own, _ in settings_of(schema) if key == "name")) == name
        arguments = {key for key, _, _ in settings_of(schema) if key != "name"}
        assert arguments == set(SCORERS.parameters(name))


@pytest.mark.parametrize(
    ("preset", "expected"),
    [
        ("default", MessagePassingConfig()),
        ("message_passing", MessagePassingConfig()),
        (
            "paper",
            MessagePassingConfig(
                hidden_dim=512,
                layers=5,
                encoder_dim=None,
                prototypes=None,
                cascade=None,
                read_out="perceptron",
                memory_mb=512,
            ),
        ),
        ("bilinear", BilinearConfig()),
        ("prototypes", PrototypesConfig()),
    ],
)
def test_model_presets(preset: str, expected: Config) -> None:
    assert compose_training(f"model={preset}").model == expected


def test_paper_experiment() -> None:
    config = compose_training("experiment=paper")
    assert isinstance(config, TrainCommandConfig)
    # Section IV-A: message passing over 5 steps with a hidden state of 512, shared weights.
    assert config.model.name == "message_passing"
    assert (config.model.hidden_dim, config.model.layers, config.model.shared_weights) == (512, 5, True)
    assert config.model.read_out == "perceptron"
    # Equations 1, 7 and 8, and Algorithm 1.
    assert config.objective == ObjectiveConfig(
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
    assert config.features.max_features == 60
    assert (config.inference.top_k, config.inference.min_drawn_weight) == (10, 0.1)
    # Of what the paper does not have, nothing: every change of state once an iteration, pictures as they are.
    assert (config.trainer.limit_train_batches, config.trainer.gradient_clip_val) == (None, None)
    assert config.early_stopping.patience is None
    assert (config.features.min_side, config.features.color) == (0, 0)
    demonstration = config.demonstration
    assert (demonstration.gap, demonstration.max_span_ratio, demonstration.batch_size) == (1, 0, 1)
    assert (demonstration.descriptor_noise, demonstration.feature_dropout) == (0, 0)
    assert (demonstration.num_negatives, demonstration.max_visible_features) == (0, None)
    assert config.ema_decay is None
    assert (config.inference.temporal, config.inference.abstain) == ("none", 0)


def test_selection_of_a_training_is_that_of_a_skill() -> None:
    plain = as_plain(InferenceConfig())
    assert plain.pop("top_k") == 10
    assert plain == as_plain(SelectionConfig())


def test_reference_names_every_key_with_its_default() -> None:
    reference = markdown_reference()
    sections = {part.partition("\n")[0]: part for part in reference.split("## ")[1:]}
    for command, schema in COMMANDS.items():
        for key, _, _ in flatten(schema):
            assert f"\n| `{key}` | " in sections[f"{command}.py"], key
    for prefix, schema, heading in (
        ("model.", MessagePassingConfig, "model=message_passing"),
        ("model.", BilinearConfig, "model=bilinear"),
        ("model.", PrototypesConfig, "model=prototypes"),
        ("task.", SimulatedTaskConfig, "task=sorting, insertion, folding, screw, flush, ring"),
        ("task.", VideoTaskConfig, "task=video"),
        ("logger.wandb.", WandbConfig, "logger=wandb"),
    ):
        for key, _, _ in flatten(schema, prefix):
            assert f"\n| `{key}` | " in sections[heading], key
    assert "| `objective.goal_weight` | `1.0` | a number of at least 0 | " in reference
    assert "| `seed` | `0` | a whole number of at least 0 | " in sections["train.py"]
    assert "| `task.num_demonstrations` | `1` | a whole number of at least 1 | " in reference
    # Of a nested configuration whose defaults are the command's own.
    assert "| `inference.abstain` | `0.0` | " in sections["evaluate.py"]
    assert "| `inference.abstain` | `0.2` | " in sections["infer.py"]
    assert "| `scenario.actor` | `robot` | " in sections["evaluate.py"]
    assert "| `descriptor.lbd.band_width` | `7` | a whole number | " in sections["descriptor=lbd"]
    rows = [line for line in reference.splitlines() if line.startswith("| `")]
    assert all(line.count(" | ") == 3 for line in rows)


def test_renamed_keys_lead_to_keys_that_exist() -> None:
    keys = {key for schema in COMMANDS.values() for key, _, _ in flatten(schema)}
    keys |= {f"task.{key}" for key, _, _ in flatten(SimulatedTaskConfig)}
    assert set(RENAMED.values()) <= keys
    assert not RENAMED.keys() & keys


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"seed": -1}, "seed=-1: expected a whole number of at least 0"),
        ({"seed": True}, "seed=true: expected a whole number of at least 0"),
        ({"seed": 1.0}, "seed=1.0: expected a whole number of at least 0"),
        ({"ema_decay": 1}, "ema_decay=1: expected a number of at least 0 and below 1, or null"),
        ({"ema_decay": float("nan")}, "ema_decay=nan: expected a number of at least 0 and below 1, or null"),
        ({"threads": 0}, "threads=0: expected a whole number of at least 1, or null"),
        ({"features": 3}, "features=3: expected FeaturesConfig"),
        ({"trainer": None}, "trainer=null: expected TrainerConfig"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_values_of_python_are_checked_too(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        TrainConfig(**settings)
    assert str(error.value) == message


def names_in(path: Path) -> Iterator[str]:
    """The names that a source file uses or imports, dotted where it imports them so."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize("path", sorted(SOURCE.rglob("*.py")), ids=lambda path: str(path.relative_to(SOURCE)))
def test_only_the_commands_know_hydra_and_nobody_instantiates(path: Path) -> None:
    names = set(names_in(path))
    assert not {"hydra.utils", "instantiate"} & names
    assert not any(name.startswith("hydra.utils") for name in names)
    if path.relative_to(SOURCE).parts[0] != "cli":
        assert not {"DictConfig", "HydraConfig"} & names
        assert not any(name.partition(".")[0] in ("hydra", "omegaconf") for name in names)
