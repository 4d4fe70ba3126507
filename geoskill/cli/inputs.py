"""Reading what several commands are given."""

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import UInt8
from omegaconf import DictConfig

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.io.camera import Camera
from geoskill.io.disk_cache import DiskCache
from geoskill.io.frames import FrameSource
from geoskill.io.sources import open_frames
from geoskill.skill.association import InferenceResult, abstain_below
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter


@runtime_checkable
class Infer(Protocol):
    """What selects associations; see :meth:`Skill.infer`."""

    def __call__(
        self, frame: UInt8[np.ndarray, "height width 3"], features: Mapping[str, FeatureSet] | None = None, /
    ) -> InferenceResult:
        """Those of the next frame."""


def required(cfg: DictConfig, key: str, expected: str) -> Any:
    """The value of a key that has no default.

    Raises:
        InputError: when it is not set.
    """
    if cfg[key] is None:
        raise InputError(f"{key} is not set; expected {expected} ({key}=…)")
    return cfg[key]


def open_recording(path: Any, frame_rate: float | None) -> FrameSource:
    """The frames of something that ends.

    Raises:
        InputError: when it cannot be opened, or is a camera.
    """
    source = open_frames(str(path), frame_rate)
    if isinstance(source, Camera):
        raise InputError(f"{path} is a camera; expected a video file or a folder of images")
    return source


def load_skill(cfg: DictConfig) -> Skill:
    """The skill of ``skill=RUN/skill.ckpt``, with the feature cache of the configuration.

    Raises:
        InputError: when there is no such skill, or the device cannot be used.
    """
    path = required(cfg, "skill", "the skill.ckpt of a training run")
    try:
        torch.zeros(1, device=cfg.device)
    except (RuntimeError, AssertionError) as error:  # the latter where PyTorch was built without that device
        raise InputError(f"device={cfg.device}: cannot be used ({error}); expected cpu, or cuda with a GPU") from error
    store = array_store(cfg)
    cache = None if store is None else FeatureCache(store)
    return Skill.load(str(path), device=cfg.device, cache=cache, precision=cfg.precision)


def use_threads(threads: int | None) -> int:
    """Let PyTorch take so many threads; None for as many as it likes. Others than PyTorch go by what this returns.

    Raises:
        InputError: when they are fewer than one.
    """
    if threads is not None:
        if threads < 1:
            raise InputError(f"threads={threads}: expected at least 1")
        torch.set_num_threads(threads)
    return torch.get_num_threads()


def array_store(cfg: DictConfig) -> DiskCache | None:
    """Where features and recordings are kept between runs, if they are."""
    return DiskCache(cfg.cache.folder, cfg.cache.limit_mb) if cfg.cache.enabled else None


def require_selection(inference: DictConfig) -> None:
    """Refuse what is no way to select.

    Raises:
        InputError: when ``temporal`` is neither ``none`` nor ``filter``, or ``abstain`` not from 0 to 1.
    """
    if inference.temporal not in ("none", "filter"):
        raise InputError(f"inference.temporal={inference.temporal}: expected none or filter")
    if not 0 <= inference.abstain <= 1:
        raise InputError(f"inference.abstain={inference.abstain}: expected a confidence from 0 (never) to 1")


def selection(skill: Skill, inference: DictConfig) -> Infer:
    """What selects associations in the frames of one video, in the order of time.

    Args:
        skill: scores them.
        inference: has ``temporal``, ``none`` for each frame by itself or ``filter`` to keep what was selected
            (:class:`TemporalFilter`), and ``abstain``, the confidence below which nothing is selected.

    Raises:
        InputError: when it has something else.
    """
    require_selection(inference)
    select = skill.infer if inference.temporal == "none" else TemporalFilter(skill).infer
    return lambda frame, features=None, /: abstain_below(select(frame, features), inference.abstain)
