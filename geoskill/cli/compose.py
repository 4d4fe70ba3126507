"""Hydra's configuration from the typed one: registered schemas, checked values, and messages that name the key."""

import ast
import contextlib
import dataclasses
import difflib
import functools
import inspect
import operator
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.global_hydra import GlobalHydra
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import ConfigCompositionException, HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from geoskill.cli.paths import with_literal_paths
from geoskill.cli.run_folder import register_new_folder
from geoskill.cli.schemas import (
    RENAMED,
    ControllerConfig,
    PlantConfig,
    SimulatedTaskConfig,
    TrainCommandConfig,
    VideoTaskConfig,
    WandbConfig,
)
from geoskill.config import AUTO, MODELS, Config, ScenarioConfig, TrainerConfig
from geoskill.errors import InputError
from geoskill.plugins import EXTRACTORS, KERNELS, SCORERS, TASKS, Registry
from geoskill.schema import as_written, check_value, expectation, settings_of

C = TypeVar("C", bound=Config)
GROUPS = ("kernel", "descriptor", "model", "task", "logger", "controller", "plant")


def configuration_folder() -> str:
    """Return where the YAML files lie: inside an installed package, beside the package in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "conf"
    return str(installed if installed.is_dir() else package.parent / "conf")


def register_schemas(command: str, schema: type[Config]) -> None:
    """Tell Hydra the schema of a command, every choice that is not a file under ``conf/``, and how folders are named.

    Built-in classes are not imported, which would take seconds: kernels and tasks have no arguments, those of networks
    are in the configuration, and those of extractors are read from their source. A plug-in is imported, since its
    arguments are those of its constructor; one that cannot be is left to the message of its use.
    """
    register_new_folder()
    store = ConfigStore.instance()
    # Hydra copies its sources, the store with all schemas among them, before whatever it looks up, a hundred times for
    # --help; what it takes from the store is a copy anyway.
    ConfigStore.__deepcopy__ = lambda self, _memo: self  # type: ignore[attr-defined]
    # What a group decides is left open here, lest one choice is merged into another.
    groups = [own.name for own in dataclasses.fields(schema) if own.name in GROUPS]  # type: ignore[arg-type]
    store.store(name=f"{command}_schema", node=schema(**dict.fromkeys(groups)))
    for name in KERNELS.built_in:
        store.store(group="kernel", name=name, node={name: {}})
    store.store(group="kernel", name=AUTO, node={AUTO: {}})
    for name in EXTRACTORS.built_in:
        store.store(group="descriptor", name=name, node={name: _schema_of_extractor(name)})
    for name, model in MODELS.items():
        store.store(group="model", name=name, node=model)
    for name in TASKS.built_in:
        store.store(group="task", name=name, node=SimulatedTaskConfig(name))
    store.store(group="task", name="video", node=VideoTaskConfig)
    store.store(group="scenario", name="human", node=ScenarioConfig)
    store.store(group="controller", name="field", node=ControllerConfig)
    store.store(group="plant", name="points", node=PlantConfig)
    store.store(group="trainer", name="cpu", node=TrainerConfig)
    store.store(group="logger", name="wandb", node={"wandb": WandbConfig})
    for registry in (KERNELS, EXTRACTORS, SCORERS, TASKS):
        for name in registry.names():
            if name not in registry.built_in:
                _register_plug_in(store, registry, name)


def _register_plug_in(store: ConfigStore, registry: Registry, name: str) -> None:
    try:
        schema: Any = _schema_of(registry, name)
    except InputError:
        schema = OmegaConf.create({}, flags={"struct": False})  # whatever it is given, its use tells what is wrong
    if registry is TASKS:
        node: Any = SimulatedTaskConfig(name)
    elif registry is not SCORERS:
        node = {name: schema}
    elif isinstance(schema, DictConfig):
        node = OmegaConf.create({"name": name}, flags={"struct": False})
    else:
        own = [("name", str, dataclasses.field(default=name))]
        node = dataclasses.make_dataclass(schema.__name__, own, bases=(schema,))
    store.store(group=registry.kind, name=name, node=node)


def _schema_of_extractor(name: str) -> type:
    """Return what :func:`_schema_of` does for a built-in extractor, from its source where that says it plainly."""
    source = Path(__file__).resolve().parents[1] / "features" / f"{name}.py"
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ClassDef) and f"name: ClassVar[str] = '{name}'" in map(ast.unparse, node.body):
            constructors = [own for own in node.body if isinstance(own, ast.FunctionDef) and own.name == "__init__"]
            try:
                entries = [entry for own in constructors for entry in _plain_arguments(own.args)]
            except ValueError:
                break
            return dataclasses.make_dataclass(f"{node.name}Config", entries)
    return _schema_of(EXTRACTORS, name)


def _plain_arguments(arguments: ast.arguments) -> Iterator[tuple[str, Any, Any]]:
    """Yield name, type and default of the arguments of a constructor.

    Raises:
        ValueError: when one has no default, or one that is no literal, or a type that is not plain.
    """
    positional, plain = arguments.args[1:], {"int": int, "float": float, "bool": bool, "str": str, "None": None}
    defaults = [*arguments.defaults, *arguments.kw_defaults]
    if arguments.posonlyargs or arguments.vararg or arguments.kwarg:
        raise ValueError("other than named arguments")
    for own, default in zip([*positional, *arguments.kwonlyargs], defaults, strict=True):
        words = ast.unparse(own.annotation).split(" | ") if own.annotation else [""]
        if default is None or not plain.keys() >= set(words):
            raise ValueError(f"{own.arg} has no default, or no plain type")
        hint = functools.reduce(operator.or_, (plain[word] for word in words))
        yield own.arg, hint, dataclasses.field(default=ast.literal_eval(default))


def _schema_of(registry: Registry, name: str) -> type:
    """Return a dataclass of the arguments that the class of a name takes, with their types and defaults."""
    entries: list[Any] = []
    for key, parameter in registry.parameters(name).items():
        required = parameter.default is inspect.Parameter.empty
        default: Any = dataclasses.field(default="???" if required else parameter.default)
        entries.append((key, parameter.annotation, default))
    return dataclasses.make_dataclass(f"{registry.get(name).__name__}Config", entries)


def compose_training(*overrides: str) -> TrainCommandConfig:
    """Return the configuration of ``train.py`` with these overrides; outside of a command, or within one."""
    register_schemas("train", TrainCommandConfig)
    overrides = tuple(with_literal_paths(overrides))
    with contextlib.ExitStack() as stack:
        if not GlobalHydra.instance().is_initialized():
            stack.enter_context(hydra.initialize_config_dir(configuration_folder(), version_base="1.3"))
        return typed(hydra.compose("train", list(overrides)), TrainCommandConfig, overrides)


def typed(cfg: DictConfig, schema: type[C], overrides: Sequence[str] = ()) -> C:
    """Return a composed configuration as its dataclass, every value checked.

    Args:
        cfg: what Hydra composed.
        schema: the dataclass.
        overrides: those that went into it. Their values are checked as they were written: OmegaConf takes 1 for true.

    Raises:
        InputError: for the first value out of range, or key that the schema lacks, named by its key.
    """
    parsed = OverridesParser.create().parse_overrides(list(overrides))
    written = {own.key_or_group: own.value() for own in parsed}
    plain = {key: value for key, value in written.items() if isinstance(value, bool | int | float | str)}
    _check_values(cfg, "", plain)
    config = OmegaConf.to_object(cfg)
    assert isinstance(config, schema)
    return config


def _check_values(node: DictConfig, prefix: str, written: Mapping[str, bool | int | float | str]) -> None:
    schema = OmegaConf.get_type(node)
    known = {name: own for name, *own in settings_of(schema)} if dataclasses.is_dataclass(schema) else {}
    for name in map(str, node):
        key = f"{prefix}{name}"
        if known and name not in known:  # which +KEY=VALUE has added
            similar = [f"{prefix}{name}, or " for name in difflib.get_close_matches(name, known, n=1)]
            raise InputError(f"{key!r}: there is no such key; expected {''.join(similar)}one of --cfg job")
        value = None if OmegaConf.is_missing(node, name) else node[name]
        if isinstance(value, DictConfig):
            _check_values(value, f"{key}.", written)
        elif name in known:
            settings_field, hint = known[name]
            text = str in (hint, *get_args(hint))  # which a number is, too
            check_value(key, value if text else written.get(key, value), settings_field, hint)


def refuse_renamed_keys() -> None:
    """Refuse keys of earlier versions on the command line.

    Raises:
        InputError: that names the present key.
    """
    for argument in sys.argv[1:]:
        key = argument.partition("=")[0].lstrip("+~")
        if key in RENAMED:
            raise InputError(f"{key}: is called {RENAMED[key]} now")


def explain_composition(error: BaseException, command: str) -> str:
    """Return in one line what Hydra or OmegaConf refuses: the key, the value and what was expected.

    Args:
        error: raised while the configuration of a command was composed.
        command: its name.
    """
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, OmegaConfBaseException) and cause.full_key:
            settings = _settings_of(cause)
            if settings is not None:
                return f"{cause.full_key}={as_written(cause.value)}: expected {expectation(*settings)}"
        cause = cause.__cause__
    several = re.match(r"Ambiguous value for argument '([^=]+)=(.*)'", str(error))
    if several:
        return (
            f"{several[1]}={several[2]}: several values; expected one, a list of them ({several[1]}=[{several[2]}]),"
            " or -m for a run with each"
        )
    unknown = re.match(r"Could not (?:override|append to|delete from config. )\W*'([^']+)'", str(error))
    if unknown and isinstance(error, ConfigCompositionException):
        return f"'{unknown[1]}': there is no such key; expected {_nearest(unknown[1], command)}one of --cfg job"
    return _one_line(error)


def _settings_of(error: OmegaConfBaseException) -> tuple[Any, Any] | None:
    """Return field and type of the setting that an error is about, unless the key is unknown."""
    schema = getattr(error, "ref_type", None)
    if not (isinstance(schema, type) and dataclasses.is_dataclass(schema)):
        schema = getattr(error, "object_type", None)
    if isinstance(schema, type) and dataclasses.is_dataclass(schema):
        for name, own, hint in settings_of(schema):
            if name == error.key:
                return own, hint
    return None


def _nearest(key: str, command: str) -> str:
    """Return the known key, or group of choices, that is most like an unknown one."""
    GlobalHydra.instance().clear()
    with hydra.initialize_config_dir(configuration_folder(), version_base="1.3"):
        groups = GlobalHydra.instance().config_loader().list_groups("")
        chosen = [argument for argument in sys.argv[1:] if argument.partition("=")[0] in groups]
        try:
            defaults = hydra.compose(command, chosen)
        except HydraException:  # the choices themselves may be what is wrong
            return ""
    keys = [name for name, _ in _leaves(OmegaConf.to_container(defaults, throw_on_missing=False))]
    similar = difflib.get_close_matches(key, [*keys, *groups], n=1)
    if not similar:  # perhaps the group was left out
        similar = [name for name in keys if name.rpartition(".")[2] == key][:1]
    if key.startswith("task.") and "task.path" not in keys:
        return "task=video for a video of yours, or "
    return f"{similar[0]}, or " if similar else ""


def _leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(node, Mapping):
        yield prefix, node
        return
    for key, value in node.items():
        if not (prefix == "" and key == "hydra"):
            yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))


def _one_line(error: BaseException) -> str:
    message = str(error)
    for noise in ("Config search path", "To append to your config", "See https:", "Set the environment variable"):
        message = message.partition(noise)[0]
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    text = " ".join(line for line in lines if not line.startswith(("full_key:", "object_type=", "reference_type=")))
    return text.rstrip(".")
