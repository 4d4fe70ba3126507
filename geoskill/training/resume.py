"""Starting from a checkpoint: going on with its training, or fine-tuning its weights on another demonstration."""

from collections.abc import Mapping, Sequence
from typing import Any

from torch import nn

from geoskill.config import TrainConfig
from geoskill.errors import InputError, shown
from geoskill.model.kernel_model import KernelModel
from geoskill.schema import as_plain, as_written
from geoskill.skill.checkpoint import StoredSkill
from geoskill.skill.spec import SkillSpec

# Arguments of a network that change neither its weights nor their meaning.
FREE_ARGUMENTS = ("cascade", "precision", "memory_mb")
TRAINING_STATE = {"callbacks", "epoch", "global_step", "loops", "optimizer_states"}


# Settings in which a training that goes on may differ from what it was: how long it takes, what it is shown on, where.
FREE_SETTINGS = (
    "threads",
    "inference",
    "early_stopping",
    "trainer.max_epochs",
    "trainer.accelerator",
    "trainer.devices",
    "trainer.strategy",
    "trainer.enable_progress_bar",
    "trainer.log_every_n_steps",
)


def require_same_run(stored: StoredSkill, spec: SkillSpec, config: TrainConfig, scene: object, count: int) -> None:
    """Refuse to go on with the training of another skill, with other settings, or from other demonstrations.

    Raises:
        InputError: in that case.
    """
    if not stored.contents.keys() >= TRAINING_STATE:
        raise InputError(
            f"{stored.path}: holds a skill, but not the state of its training; expected init_from={stored.path}"
        )
    _require_state(stored)
    _require_same_parts(stored, spec, free=())
    if stored.provenance.scene != scene:
        raise InputError(
            f"{stored.path}: learned from {_named(stored.provenance.scene)}; expected what this run learns from,"
            f" {_named(scene)}"
        )
    _require_same_settings(stored, config)
    learned = len(stored.provenance.sources)
    if learned != count:
        raise InputError(f"{stored.path}: learned from {learned} demonstration(s); expected {count}, as this run")


def require_same_spans(stored: StoredSkill, spans: Sequence[int]) -> None:
    """Refuse a checkpoint that learned from transitions over other spans of time.

    Raises:
        InputError: in that case.
    """
    for weights in stored.weights.values():
        learned = weights["spans"].tolist() if "spans" in weights else []
        if learned != list(spans):
            raise InputError(
                f"{stored.path}: learned from transitions over {learned} frames; expected those of this demonstration,"
                f" {list(spans)} (init_from= starts from a skill's weights on another demonstration)"
            )


def is_complete(stored: StoredSkill, config: TrainConfig) -> bool:
    """Return whether a checkpoint has all of its epochs, or was finished before them by early stopping."""
    done, wanted = stored.provenance.epochs
    stopped_early = stored.provenance.finished and done < wanted and config.early_stopping.patience is not None
    return stopped_early or done >= config.trainer.max_epochs


def initialize(members: Mapping[str, KernelModel], spec: SkillSpec, stored: StoredSkill) -> None:
    """Give members the trained network of a skill: its weights and the prototypes that they belong to.

    What is fitted to a demonstration is left out: it is fitted to the new one. Demonstrations, objective, optimizer,
    seed and the network's ``cascade``, ``precision`` and ``memory_mb`` may differ.

    Raises:
        InputError: when the skill has other members, descriptors, features or another network.
    """
    _require_same_parts(stored, spec, free=FREE_ARGUMENTS)
    for name, member in members.items():
        prefix = "scorer."
        weights = {key.removeprefix(prefix): own for key, own in stored.weights[name].items() if key.startswith(prefix)}
        scorer: nn.Module = member.scorer
        try:
            scorer.load_state_dict(weights)
        except RuntimeError as error:
            message = " ".join(str(error).split())[:200]
            raise InputError(f"{stored.path}: its weights do not fit its specification ({message})") from error


def _require_state(stored: StoredSkill) -> None:
    """Refuse what is no state of a training, as far as this package reads it; Lightning reads the rest.

    Raises:
        InputError: in that case.
    """
    rows: object = []
    callbacks = stored.contents["callbacks"]
    if isinstance(callbacks, Mapping):
        table = callbacks.get("MetricsTable", {"rows": []})
        rows = table.get("rows") if isinstance(table, Mapping) else None
    is_table = isinstance(rows, list) and all(
        isinstance(row, Mapping) and all(isinstance(name, str) and type(row[name]) in (int, float) for name in row)
        for row in rows
    )
    steps = stored.contents["global_step"]
    if not (is_table and isinstance(callbacks, Mapping) and type(steps) is int and steps >= 0):
        raise InputError(
            f"{stored.path}: the state of its training has callbacks {shown(callbacks)} and global_step {shown(steps)};"
            " expected those of a training of this program"
        )


def _require_same_settings(stored: StoredSkill, config: TrainConfig) -> None:
    theirs, ours = _flat(stored.provenance.configuration), _flat(as_plain(config))
    # What earlier versions did not have yet is not compared; kernel, descriptor, model and features are, as parts.
    free = (*FREE_SETTINGS, "kernel", "descriptor", "model", "features")
    names = [name for name in ours if name in theirs and not any(f"{name}.".startswith(f"{own}.") for own in free)]
    changed = [name for name in names if theirs[name] != ours[name]]
    if changed:
        before, now = (
            ", ".join(f"{name}={as_written(values[name])}" for name in changed)[:200] for values in (theirs, ours)
        )
        raise InputError(
            f"{stored.path}: was trained with {before}; expected {now}, as in this run (init_from= starts from its"
            " weights with other settings)"
        )


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested settings by their dotted names.

    >>> _flat({"optimizer": {"lr": 0.1}, "seed": 0})
    {'optimizer.lr': 0.1, 'seed': 0}
    """
    flat: dict[str, Any] = {}
    for name, value in values.items():
        flat |= _flat(value, f"{prefix}{name}.") if isinstance(value, Mapping) else {f"{prefix}{name}": value}
    return flat


def _require_same_parts(stored: StoredSkill, spec: SkillSpec, free: Sequence[str]) -> None:
    for name in ("members", "extractors", "model", "features"):
        theirs, ours = as_plain(getattr(stored.spec, name)), as_plain(getattr(spec, name))
        if name == "model":
            for part in (theirs, ours):
                part["arguments"] = {key: value for key, value in part["arguments"].items() if key not in free}
        if theirs != ours:
            if name in ("members", "extractors") and set(theirs) != set(ours):
                theirs, ours = ", ".join(theirs), ", ".join(ours)  # their names tell enough
            elif isinstance(theirs, dict) and isinstance(ours, dict):
                theirs, ours = _differences(theirs, ours)
            may = "; demonstrations, objective, optimizer and seed may differ" if free else ""
            raise InputError(f"{stored.path}: has {name} {theirs}; expected {ours}, as in this run{may}")


def _differences(theirs: dict[str, Any], ours: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the entries in which two mappings differ."""
    keys = [key for key in {**theirs, **ours} if theirs.get(key) != ours.get(key)]
    if len(keys) == 1 and all(isinstance(values.get(keys[0]), dict) for values in (theirs, ours)):
        return _differences(theirs[keys[0]], ours[keys[0]])
    return {key: theirs.get(key) for key in keys}, {key: ours.get(key) for key in keys}


def _named(scene: object) -> str:
    return "a video" if scene is None else str(scene)
