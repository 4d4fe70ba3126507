"""Checkpoints of skills: where they lie, what they hold, and where the skill comes from.

A checkpoint is a dictionary of plain values and tensors, as Lightning writes it, with the entry ``skill``::

    skill:
      specification: ...      SkillSpec
      provenance: ...         Provenance
      preferences: ...        FeaturePreference by the extractor's name, where there is one

It may come from anybody: nothing in it is called, imported or opened, and it takes no more memory than the file is
large (:mod:`geoskill.io.tensor_file`); ``docs/formats`` has the type and bounds of every entry.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, final

import torch

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError, shown
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.preference import FeaturePreference
from geoskill.io.atomic import atomic_open
from geoskill.io.tensor_file import load_tensors
from geoskill.schema import WORDS, as_plain
from geoskill.skill.choice import Choice
from geoskill.skill.plain import mapping_of, require_plain, text_of
from geoskill.skill.spec import SkillSpec
from geoskill.skill.weights import require_finite

CHECKPOINT = "skill.ckpt"
WANDB_PREFIX = "wandb:"
MAX_MESSAGE = 1000
"""Characters of a message about a checkpoint, whose values may be of any length."""


@final
@dataclass(frozen=True)
class SimulatedScene:
    """The simulated scene that a demonstration shows: another recording of it shows the same things."""

    task: str
    seed: int
    scenario: ScenarioConfig

    @classmethod
    def from_plain(cls, value: object) -> "SimulatedScene":
        """Read the scene of a checkpoint: plain values into named fields.

        Raises:
            InputError: when it is something else.
        """
        entries = mapping_of(value, "provenance.scene", ("task", "seed", "scenario"))
        scenario = mapping_of(entries["scenario"], "provenance.scene.scenario", _names(ScenarioConfig))
        if type(entries["seed"]) is not int or entries["seed"] < 0:
            raise InputError(
                f"the skill's provenance.scene.seed is {shown(entries['seed'])}; expected a whole number of at least 0"
            )
        try:
            conditions = ScenarioConfig(**scenario)
        except InputError as error:
            raise InputError(f"the skill's provenance.scene.scenario: {error}") from error
        return cls(text_of(entries["task"], "provenance.scene.task"), entries["seed"], conditions)


@final
@dataclass(frozen=True)
class Provenance:
    """Where a skill comes from.

    Attributes:
        sources: the demonstrations, as they were called.
        image_size: width and height of the first demonstration, in pixels.
        date: when the training began, ISO 8601.
        version: of this package.
        seed: of the training.
        finished: whether training and calibration were completed; the confidence means nothing before.
        epochs: that were trained, and that were wanted.
        metrics: of the last epoch.
        configuration: of the training, for the reader.
        scene: the simulated scene of the demonstrations, if they were simulated.
        choice: which members were kept, if the demonstration chose them.
    """

    sources: tuple[str, ...]
    image_size: tuple[int, int]
    date: str
    version: str
    seed: int
    finished: bool = False
    epochs: tuple[int, int] = (0, 0)
    metrics: Mapping[str, float] = field(default_factory=dict)
    configuration: Mapping[str, Any] = field(default_factory=dict)
    scene: SimulatedScene | None = None
    choice: Choice | None = None

    @classmethod
    def from_plain(cls, value: object) -> "Provenance":
        """Read the provenance of a checkpoint.

        Raises:
            InputError: when it has anything but plain values of the expected types.
        """
        entries = mapping_of(value, "provenance", _names(cls))
        for name, kind in (("date", str), ("version", str), ("seed", int), ("finished", bool)):
            if type(entries[name]) is not kind:
                raise InputError(f"the skill's provenance.{name} is {shown(entries[name])}; expected {WORDS[kind]}")
        sizes = {name: _integers(entries[name], f"provenance.{name}") for name in ("image_size", "epochs")}
        if not isinstance(entries["sources"], list):
            raise InputError(f"the skill's provenance.sources are {shown(entries['sources'])}; expected a list")
        require_plain(entries["configuration"], "provenance.configuration")
        metrics = mapping_of(entries["metrics"], "provenance.metrics")
        if not all(isinstance(metric, int | float) for metric in metrics.values()):
            raise InputError(f"the skill's provenance.metrics are {shown(metrics)}; expected numbers")
        return cls(
            sources=tuple(text_of(source, "provenance.sources") for source in entries["sources"]),
            image_size=sizes["image_size"],
            date=entries["date"],
            version=entries["version"],
            seed=entries["seed"],
            finished=entries["finished"],
            epochs=sizes["epochs"],
            metrics=metrics,
            configuration=mapping_of(entries["configuration"], "provenance.configuration"),
            scene=None if entries["scene"] is None else SimulatedScene.from_plain(entries["scene"]),
            choice=None if entries["choice"] is None else Choice.from_plain(entries["choice"], "provenance.choice"),
        )


@final
@dataclass(frozen=True, eq=False)
class StoredSkill:
    """What a checkpoint says of a skill, and its weights.

    Attributes:
        path: of the checkpoint.
        spec: what the skill is made of.
        provenance: where it comes from.
        preferences: which features it keeps, by the extractor's name.
        weights: of each member, by the names of its state.
        contents: all of the checkpoint, to go on with its training.
    """

    path: Path
    spec: SkillSpec
    provenance: Provenance
    preferences: Mapping[str, FeaturePreference]
    weights: Mapping[str, Mapping[str, torch.Tensor]]
    contents: Mapping[str, Any]


def skill_entry(spec: SkillSpec, provenance: Provenance, pipelines: Mapping[str, FeaturePipeline]) -> dict[str, Any]:
    """Return the entry ``skill`` of a checkpoint."""
    preferences = {
        name: {
            "groups": [torch.from_numpy(group) for group in pipeline.preference.groups],
            "others": torch.from_numpy(pipeline.preference.others),
        }
        for name, pipeline in pipelines.items()
        if pipeline.preference is not None
    }
    return {"specification": spec.as_plain(), "provenance": as_plain(provenance), "preferences": preferences}


def read_skill(reference: str | Path) -> StoredSkill:
    """Read a skill's checkpoint.

    Args:
        reference: a checkpoint, a run folder with a ``skill.ckpt``, or ``wandb:ENTITY/PROJECT/NAME:ALIAS``.

    Raises:
        InputError: when there is none, it is no checkpoint of a skill, or a weight is not finite.
    """
    path = _located(str(reference))
    try:
        contents = load_tensors(path)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{path}: cannot be read as a checkpoint ({error}); expected the skill.ckpt of a training run"
        ) from error
    if not isinstance(contents, dict) or not {"skill", "state_dict"} <= contents.keys():
        raise InputError(f"{path}: is no skill of this program; expected the skill.ckpt of a training run")
    try:
        entry = contents["skill"]
        if isinstance(entry, Mapping) and "format" in entry:  # the specification itself, until format 2
            SkillSpec.from_plain(entry)
        entries = mapping_of(entry, "entry", ("specification", "provenance", "preferences"))
        spec, provenance = SkillSpec.from_plain(entries["specification"]), Provenance.from_plain(entries["provenance"])
        preferences = {
            name: _preference(value, f"preferences.{name}")
            for name, value in mapping_of(entries["preferences"], "preferences").items()
        }
        weights: dict[str, dict[str, torch.Tensor]] = {name: {} for name in spec.members}
        for key, value in mapping_of(contents["state_dict"], "state_dict").items():
            _, _, rest = key.partition("members.")
            member, _, name = rest.partition(".")
            if member in weights and isinstance(value, torch.Tensor):
                weights[member][name] = value
        for member, own in weights.items():
            require_finite({f"{member}.{name}": value for name, value in own.items()})
    except InputError as error:
        raise InputError(f"{path}: {str(error)[:MAX_MESSAGE]}") from error
    return StoredSkill(path, spec, provenance, preferences, weights, contents)


def write_checkpoint(path: str | Path, contents: Mapping[str, Any]) -> None:
    """Write a checkpoint; an older file stays until the new one is complete."""
    with atomic_open(Path(path), "wb") as file:
        torch.save(dict(contents), file)


def _located(reference: str) -> Path:
    if reference.startswith(WANDB_PREFIX):
        return _from_wandb(reference)
    path = Path(reference).expanduser()
    return _existing(path / CHECKPOINT if path.is_dir() else path)


def _existing(path: Path) -> Path:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected the skill.ckpt of a training run, or its folder")
    return path


def _from_wandb(reference: str) -> Path:
    import wandb

    name = reference.removeprefix(WANDB_PREFIX)
    if name.count("/") != 2 or ":" not in name:
        raise InputError(f"{reference}: expected wandb:ENTITY/PROJECT/NAME:ALIAS")
    try:
        folder = wandb.Api().artifact(name, type="skill").download()
    except Exception as error:  # not reachable, not logged in, not there: wandb raises a dozen kinds of errors
        message = " ".join(str(error).split())[:200]
        raise InputError(f"{reference}: cannot be fetched ({message}); expected the artifact of a training") from error
    return _existing(Path(folder) / CHECKPOINT)


def _names(schema: type) -> list[str]:
    return [own.name for own in fields(schema)]


def _preference(value: object, where: str) -> FeaturePreference:
    entries = mapping_of(value, where, ("groups", "others"))
    groups = entries["groups"] if isinstance(entries["groups"], list) else [None]
    arrays = []
    for tensor in (*groups, entries["others"]):
        if not isinstance(tensor, torch.Tensor) or tensor.dtype != torch.float32:
            raise InputError(f"the skill's {where} holds {type(tensor).__name__}; expected float32 descriptors")
        arrays.append(tensor.numpy())
    try:
        return FeaturePreference(tuple(arrays[:-1]), arrays[-1])
    except ValueError as error:
        raise InputError(f"the skill's {where}: {error}") from error


def _integers(value: object, where: str) -> tuple[int, int]:
    if not (isinstance(value, list) and len(value) == 2 and all(type(number) is int for number in value)):
        raise InputError(f"the skill's {where} is {shown(value)}; expected two whole numbers")
    return value[0], value[1]
