"""The stages of a live video, each alone and all together."""

from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from typing import final

import numpy as np
import torch

from geoskill.benchmarks.measurement import Workload
from geoskill.cli.reporting import extracted_ahead
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.prefetch import prefetch_map
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec
from geoskill.skill.temporal_filter import TemporalFilter

# The workload that the others are compared with.
EXTRACT = "extract"
OVERLAPPED = "all, overlapped"


@final
@dataclass(frozen=True, eq=False)
class Stages:
    """The first frames of a video, and an untrained skill with that video as its demonstration.

    Attributes:
        source: the video; every workload that reads opens it again.
        frames: its first frames.
        features: of each of these frames, by the extractor's name.
        skill: as expensive as a trained one.
        threads: number of frames processed at once where stages overlap.
    """

    source: FrameSource
    frames: Sequence[Frame]
    features: Sequence[dict[str, FeatureSet]]
    skill: Skill
    threads: int

    @classmethod
    def of(cls, source: FrameSource, count: int, spec: SkillSpec, device: str, threads: int) -> "Stages":
        """Read and extract the first ``count`` frames, or all if there are fewer, and fit the skill's prototypes.

        Raises:
            InputError: when the frames cannot be read, or contain no feature of a type that a kernel needs.
        """
        frames = list(islice(source, count))
        size = (frames[0].image.shape[1], frames[0].image.shape[0])
        skill = Skill(build_skill(spec), spec, Provenance((source.name,), size, date="", version="", seed=0))
        features = [skill.extract(frame.image) for frame in frames]
        for name, member in skill.members.items():
            descriptors = {
                node_type: np.concatenate([feature_sets[extractor].descriptors for feature_sets in features])
                for node_type, extractor in member.extractors.items()
            }
            for node_type, rows in descriptors.items():
                if len(rows) == 0:
                    raise InputError(f"{source.name}: no {node_type} in {len(frames)} frames; expected some for {name}")
            member.scorer.fit_prototypes({node_type: torch.from_numpy(rows) for node_type, rows in descriptors.items()})
            member.to(device)
        return cls(source, frames, features, skill, threads)

    def workloads(self) -> dict[str, Workload]:
        """Return the workloads by name; each goes through all frames once, with the code of ``infer.py``.

        Nothing is written.
        """
        return {
            "read": lambda: sum(1 for _ in self._read()),
            EXTRACT: lambda: [self.skill.extract(frame.image) for frame in self.frames],
            f"{EXTRACT}, {self.threads} at once": self._extract_at_once,
            "select": lambda: self._select(zip(self.frames, self.features, strict=True)),
            "all, in turn": lambda: self._run_all(threads=1),
            OVERLAPPED: lambda: self._run_all(self.threads),
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

    def _run_all(self, threads: int) -> None:
        with closing(extracted_ahead(self.skill, self._read(), threads, live=False)) as extracted:
            self._select(extracted)
