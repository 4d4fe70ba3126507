"""From what a user calls a demonstration to the transitions that training learns from."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
import torch

from geoskill.config import TrainConfig
from geoskill.data.demonstration import Demonstration
from geoskill.data.demonstrations import Demonstrations
from geoskill.errors import InputError
from geoskill.io.arrays import ArrayFrames
from geoskill.io.frames import FrameSource
from geoskill.io.kept_frames import Depths, Pictures
from geoskill.io.prefetch import Progress
from geoskill.io.sources import is_live, open_frames, read_all
from geoskill.schema import as_plain
from geoskill.skill.build import SkillComponents
from geoskill.skill.checkpoint import Provenance, SimulatedScene

Source = str | Path | FrameSource | np.ndarray | Sequence[np.ndarray]
"""A path, an opened source, or RGB pictures: an array ``[T, H, W, 3]`` or a sequence of ``[H, W, 3]``, uint8."""

DEMONSTRATIONS = "a video file, a folder of images, or an array of pictures"


def as_sources(demonstrations: Source | Iterable[Source]) -> Sequence[Source] | Iterable[Source]:
    """Return demonstrations one by one; a single one becomes a sequence of one.

    Raises:
        InputError: when there cannot be any in it.
    """
    if isinstance(demonstrations, str | Path | FrameSource | np.ndarray):
        return [demonstrations]
    if not isinstance(demonstrations, Iterable):
        raise InputError(f"demonstrations={demonstrations!r}: expected {DEMONSTRATIONS}")
    if isinstance(demonstrations, Sequence) and len(demonstrations) and np.ndim(_picture(demonstrations[0])) in (2, 3):
        return [[_picture(picture) for picture in demonstrations]]  # the pictures of one
    return demonstrations


def prepare(
    config: TrainConfig,
    sources: Iterable[Source],
    components: SkillComponents,
    progress: Progress | None,
    scene: SimulatedScene | None,
    *,
    every_member: bool = True,
) -> tuple[Demonstrations, Provenance]:
    """Extract the features of every demonstration and follow them through it.

    Args:
        config: of the training.
        sources: the demonstrations; read one after the other, no picture is kept.
        components: kernels, and the pipelines that feed them; these then keep what the demonstrations tell to prefer.
        progress: shows progress over a sequence, or None.
        scene: the simulated scene that the demonstrations show.
        every_member: each demonstration needs an instance of every member, not only of some.

    Raises:
        InputError: when one cannot be read, is too short, or has no instance of some member.
    """
    prepared, names, size = [], [], (0, 0)
    for number, source in enumerate(sources, start=1):
        opened = _opened(source, number)
        frames = read_all(opened, minimum=config.demonstration.gap + 1)
        pictures = Pictures(frames)
        prepared.append(
            Demonstration(
                pictures,
                components.pipelines,
                components.members,
                gap=config.demonstration.gap,
                max_span_ratio=config.demonstration.max_span_ratio,
                num_negatives=config.demonstration.num_negatives,
                use_places=config.demonstration.use_places,
                progress=_silent if progress is None else progress,
                name=opened.name,
                threads=torch.get_num_threads(),
                trajectory=config.demonstration.trajectory,
                negatives=config.demonstration.negatives,
                depths=None if frames[0].depth is None else Depths(frames),
                every_member=every_member,
            )
        )
        names.append(opened.name)
        size = size if any(size) else (pictures[0].shape[1], pictures[0].shape[0])
    if not prepared:
        raise InputError(f"no demonstration; expected {DEMONSTRATIONS}")
    demonstrations = Demonstrations(prepared)
    for extractor, preference in demonstrations.preferences.items():
        components.pipelines[extractor] = components.pipelines[extractor].preferring(preference)
    provenance = Provenance(
        sources=tuple(names),
        image_size=size,
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        version=version("geoskill"),
        seed=config.seed,
        configuration=as_plain(config),
        scene=scene,
    )
    return demonstrations, provenance


def _opened(source: Source, number: int) -> FrameSource:
    if isinstance(source, FrameSource):
        opened = source
    elif isinstance(source, str | Path):
        opened = open_frames(source)
    elif isinstance(source, np.ndarray | list | tuple):
        opened = ArrayFrames(source, name=f"demonstration {number}")
    else:
        raise InputError(f"demonstration {number} is {source!r}; expected {DEMONSTRATIONS}")
    if is_live(opened):
        raise InputError(f"{opened.name} is a camera; expected a video file or a folder of images")
    return opened


def _picture(value: object) -> np.ndarray:
    return value if isinstance(value, np.ndarray) else np.zeros(0)


def _silent(items: Sequence[int], description: str) -> Iterator[int]:
    return iter(items)
