"""Whether a training can go on from a checkpoint."""

from collections.abc import Mapping, Sequence
from typing import Any

from omegaconf import DictConfig

from geoskill.errors import InputError


def require_same_skill(cfg: DictConfig, checkpoint: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    """Refuse a checkpoint of another skill, or one that has all of its epochs.

    Args:
        cfg: has ``ckpt_path`` and ``trainer.max_epochs``.
        checkpoint: what was read there.
        wanted: the description of the skill of this run.

    Raises:
        InputError: in that case.
    """
    stored = checkpoint["skill"]
    for part in ("members", "extractors", "model", "features"):
        theirs, ours = stored.get(part), wanted[part]
        if theirs != ours:
            if part in ("members", "extractors") and set(theirs) != set(ours):
                theirs, ours = ", ".join(theirs), ", ".join(ours)  # their names tell enough
            raise InputError(f"ckpt_path={cfg.ckpt_path}: its {part} are {theirs}; expected those of this run, {ours}")
    if stored.get("learned_from") != wanted.get("learned_from"):
        raise InputError(
            f"ckpt_path={cfg.ckpt_path}: learned from {stored.get('learned_from', 'a video')}; expected what this run"
            f" learns from, {wanted.get('learned_from', 'a video')}"
        )
    theirs, ours = (each.get("demonstrations", 1) for each in (stored, wanted))
    if theirs != ours:
        raise InputError(
            f"ckpt_path={cfg.ckpt_path}: learned from {theirs} demonstration(s); expected {ours}, as this run"
        )
    epochs = checkpoint["loops"]["fit_loop"]["epoch_progress"]["current"]["processed"]
    if -1 < cfg.trainer.max_epochs <= epochs:
        raise InputError(
            f"ckpt_path={cfg.ckpt_path}: has all of its {epochs} epochs; expected trainer.max_epochs to be more"
        )


def require_same_spans(cfg: DictConfig, checkpoint: Mapping[str, Any], spans: Sequence[int]) -> None:
    """Refuse a checkpoint that learned from transitions over other spans of time.

    Raises:
        InputError: in that case.
    """
    for name, values in checkpoint["state_dict"].items():
        if name.endswith(".spans") and values.tolist() != list(spans):
            raise InputError(
                f"ckpt_path={cfg.ckpt_path}: learned from transitions over {values.tolist()} frames;"
                f" expected those of this demonstration, {list(spans)}"
            )
