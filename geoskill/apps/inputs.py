"""Reading what several commands are given."""

from typing import Any

from omegaconf import DictConfig

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.skill.skill import Skill


def required(cfg: DictConfig, key: str, expected: str) -> Any:
    """The value of a key that has no default.

    Raises:
        InputError: when it is not set.
    """
    if cfg[key] is None:
        raise InputError(f"{key} is not set; expected {expected} ({key}=…)")
    return cfg[key]


def load_skill(cfg: DictConfig) -> Skill:
    """The skill of ``skill=RUN/skill.ckpt``, with the feature cache of the configuration."""
    path = required(cfg, "skill", "the skill.ckpt of a training run")
    cache = FeatureCache(cfg.cache.folder, cfg.cache.limit_mb) if cfg.cache.enabled else None
    return Skill.load(path, device=cfg.device, cache=cache)
