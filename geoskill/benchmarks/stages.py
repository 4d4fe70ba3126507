"""What a live video needs done, each stage alone and all of them together."""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np
import torch

from geoskill.benchmarks.measurement import Work
from geoskill.cli.reporting import extracted_ahead
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.prefetch import prefetch_map
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillComponents
from geoskill.skill.temporal_filter import TemporalFilter

# The way that the others are compared with.
EXTRACT = "extract"
OVERLAPPED = "all, overlapped"


@final
@dataclass(frozen=True, eq=False)
class Stages:
    """The beginning of a video, and an untrained skill that has it for its demonstration.

    Attributes:
        source: read again by every way that reads.
        frames: the first ones.
        features: theirs, by the extractor's name.
        skill: of the same cost as a trained one.
        threads: how many frames are worked on at once where stages overlap.
    """

    source: FrameSource
    frames: Sequence[Frame]
    features: Sequence[dict[str, FeatureSet]]
    skill: Skill
    threads: int

    @classmethod
    def of(cls, source: FrameSource, count: int, parts: SkillComponents, device: str, threads: int) -> "Stages":
        """The first ``count`` frames, or all if there are fewer.

        Raises:
            InputError: when they cannot be read, or have no feature that a kernel needs.
        """
        frames = list(islice(source, count))
        skill = Skill(parts)
        features = [skill.extract(frame.image) for frame in frames]
        for name, member in skill.members.items():
            rows = {
                kind: np.concatenate([found[extractor].descriptors for found in features])
                for kind, extractor in member.extractors.items()
            }
            for kind, of_kind in rows.items():
                if len(of_kind) == 0:
                    raise InputError(f"{source.name}: no {kind} in {len(frames)} frames; expected some for {name}")
            member.scorer.fit_prototypes({kind: torch.from_numpy(of_kind) for kind, of_kind in rows.items()})
            member.to(device)
        return cls(source, frames, features, skill, threads)

    def ways(self) -> dict[str, Work]:
        """Each goes through all frames once, by the code that ``infer.py`` uses; nothing is written."""
        return {
            "read": lambda: sum(1 for _ in self._read()),
            EXTRACT: lambda: [self.skill.extract(frame.image) for frame in self.frames],
            f"{EXTRACT}, {self.threads} at once": self._extract_at_once,
            "select": lambda: self._select(zip(self.frames, self.features, strict=True)),
            "all, in turn": lambda: self._all(threads=1),
            OVERLAPPED: lambda: self._all(self.threads),
        }

    def _read(self) -> Iterable[Frame]:
        return islice(self.source, len(self.frames))

    def _extract_at_once(self) -> None:
        images = [frame.image for frame in self.frames]
        for _ in prefetch_map(self.skill.extract, images, threads=self.threads):
            pass

    def _select(self, extracted: Iterable[tuple[Frame, dict[str, FeatureSet]]]) -> None:
        infer = TemporalFilter(self.skill).infer
        for frame, features in extracted:
            infer(frame.image, features)

    def _all(self, threads: int) -> None:
        with closing(extracted_ahead(self.skill, self._read(), threads, live=False)) as extracted:
            self._select(extracted)
