"""Opening what a command is given."""

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, Protocol, runtime_checkable

import numpy as np
import torch
from jaxtyping import UInt8

from geoskill.cli.schemas import CacheConfig
from geoskill.config import InferenceConfig, SelectionConfig
from geoskill.errors import InputError, missing_extra
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.io.choice import Choice
from geoskill.io.disk_cache import DiskCache
from geoskill.io.frames import FrameSource
from geoskill.io.sources import is_live, open_frames
from geoskill.schema import as_written
from geoskill.skill.association import InferenceResult, abstain_below
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter


@runtime_checkable
class Infer(Protocol):
    """What selects associations; see :meth:`Skill.infer`."""

    def __call__(
        self,
        frame: UInt8[np.ndarray, "height width 3"],
        features: Mapping[str, FeatureSet] | None = None,
        depth: DepthPicture | None = None,
        /,
    ) -> InferenceResult:
        """Select those of the next frame."""


def required(key: str, value: Any, expected: str) -> Any:
    """Return the value of a key that has no default.

    Raises:
        InputError: when it is not set.
    """
    if value is None:
        raise InputError(f"{key} is not set; expected {expected} ({key}=…)")
    return value


def open_recording(
    path: Any, frame_rate: float | None, choice: Choice | None = None, *, strict_video: bool = False
) -> FrameSource:
    """Open frames that come to an end; see :func:`~geoskill.io.sources.open_frames`.

    Raises:
        InputError: when they cannot be opened, or are those of a camera or of a live stream.
    """
    source = open_frames(str(path), frame_rate, choice, strict_video=strict_video)
    if is_live(source):
        raise InputError(f"{source.name} is a camera; expected a video file or a folder of images")
    return source


def load_skill(
    reference: str | None,
    device: str,
    precision: str | None,
    store: DiskCache | None,
    definition: str | None = None,
) -> Skill:
    """Load the skill of ``skill=``, which obeys the edited definition of ``definition=``.

    Raises:
        InputError: when there is no such skill, the device cannot be used, or the definition has an edit that cannot be
            made.
    """
    path = required("skill", reference, "the skill.ckpt of a training run, or its folder")
    try:
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError) as error:  # the latter where PyTorch was built without that device
        raise InputError(f"device={device}: cannot be used ({error}); expected cpu, or cuda with a GPU") from error
    cache = None if store is None else FeatureCache(store)
    return Skill.load(path, device=device, cache=cache, precision=precision, definition=definition)


def rerun_of(value: Any) -> bool | str:
    """Return what ``rerun=`` asks for.

    Raises:
        InputError: when it is something else, or rerun is not installed.
    """
    if value not in (True, False, "live"):
        raise InputError(f"rerun={value}: expected true, false or live")
    if value and find_spec("rerun") is None:
        raise missing_extra(f"rerun={as_written(value)}", "rerun")
    return bool(value) if value != "live" else "live"


def use_threads(threads: int | None) -> int:
    """Let PyTorch take so many threads, None for as many as it likes, and return their number."""
    if threads is not None:
        torch.set_num_threads(threads)
    return torch.get_num_threads()


def open_disk_cache(config: CacheConfig) -> DiskCache | None:
    """Return where features and recordings are kept between runs, if they are."""
    return DiskCache(config.folder, config.limit_mb) if config.enabled else None


def selection(skill: Skill, config: SelectionConfig | InferenceConfig) -> Infer:
    """Return what selects associations in the frames of one video, in the order of time.

    Args:
        skill: scores them.
        config: whether over time (:class:`TemporalFilter`), and the confidence below which nothing is selected.
    """
    select = skill.infer if config.temporal == "none" else TemporalFilter(skill, config.filter).infer
    return lambda frame, features=None, depth=None, /: abstain_below(select(frame, features, depth), config.abstain)
