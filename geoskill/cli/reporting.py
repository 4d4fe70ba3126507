"""The files of a run that say what a skill selected: associations, overlay, definition and metrics."""

import json
from collections.abc import Generator, Iterable, Iterator, Mapping, Sized
from contextlib import AbstractContextManager, closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np
import yaml
from jaxtyping import UInt8

from geoskill.cli.end_of_task import EndOfTask
from geoskill.cli.inputs import Infer
from geoskill.cli.progress import show_progress
from geoskill.features.feature_set import FeatureSet
from geoskill.io.atomic import atomic_open, line_open
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.prefetch import prefetch_map
from geoskill.io.sources import is_live
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import InferenceResult
from geoskill.skill.definition import FOLDER, TaskDefinition
from geoskill.skill.definition_edit import EDITING
from geoskill.skill.skill import Skill
from geoskill.viz.crops import draw_crop, write_picture
from geoskill.viz.curves import plot_inference
from geoskill.viz.overlay import draw_associations, draw_overlay
from geoskill.viz.strip import ErrorHistory
from geoskill.viz.video_writer import VideoWriter

if TYPE_CHECKING:
    from geoskill.cli.exporting import FrameExports
    from geoskill.viz.rerun_log import RerunLog


def write_inference(
    skill: Skill,
    infer: Infer,
    frames: Iterable[Frame],
    source: FrameSource,
    folder: Path,
    min_drawn_weight: float,
    metrics: Mapping[str, Any],
    threads: int,
    rerun: bool | str = False,
    exports: "FrameExports | None" = None,
) -> dict[str, Any]:
    """Select associations in every frame and write the results into ``folder``; return the contents of metrics.json.

    A camera's frames end with Ctrl-C. Where frames end otherwise, by Ctrl-C, a damaged source or any failure but one to
    write, the results up to there are written first, unless ``folder`` holds earlier results, which stay. Associations
    of a camera are in their file once they are selected.

    Args:
        skill: has the members.
        infer: selects the associations.
        frames: one after the other; may be endless.
        source: gives the name and the frame rate.
        folder: an existing folder.
        min_drawn_weight: select-out below which associations other than the best are not drawn.
        metrics: added where the names are new.
        threads: number of frames whose features are extracted at once, while associations are selected in another;
            with one, each frame is finished before the next is read.
        rerun: whether to write a recording for rerun, or ``live`` to show it in its viewer.
        exports: files for other programs, or None.

    Raises:
        InputError: where the source is damaged, or rerun cannot be used.
        KeyboardInterrupt: after Ctrl-C, unless the source is a camera.
    """
    total = len(frames) if isinstance(frames, Sized) else None
    results = _Results(skill, source, total)
    failure: BaseException | None = None
    path = folder / "associations.jsonl"
    had_earlier = path.exists()
    with (
        line_open(path, as_they_come=is_live(source)) as lines,
        VideoWriter(folder / "overlay.mp4", source.frame_rate) as video,
        closing(extracted_ahead(skill, frames, threads, live=is_live(source))) as extracted,
        _rerun_log(rerun, folder, source.name) as log,
    ):
        try:
            for frame, features in show_progress(extracted, "selecting associations", total):
                result = infer(frame.image, features, frame.depth)
                described = list(association_lines(frame, result, skill.members))
                lines.writelines(json.dumps(line) + "\n" for line in described)
                if exports is not None:
                    exports.add(frame, result, described)
                video.write(results.overlay(frame, result, min_drawn_weight), frame.time_s)
                results.add(frame, result)
                if log is not None:
                    log.add(frame, result)
        except (KeyboardInterrupt, Exception) as error:
            if not (isinstance(error, KeyboardInterrupt) and is_live(source)):
                if isinstance(error, OSError) or results.frames == 0 or had_earlier:
                    raise
                failure = error
    summary = results.write(folder, metrics)
    if failure is not None:
        raise failure
    return summary


def _rerun_log(rerun: bool | str, folder: Path, name: str) -> "AbstractContextManager[RerunLog | None]":
    if rerun is False:
        return nullcontext()
    from geoskill.viz.rerun_log import RerunLog

    return RerunLog(folder, live=rerun == "live", title=name)


@final
class _Results:
    """What is collected over the frames of a video.

    Args:
        skill: has the members.
        source: gives the name.
        total: number of frames, where it is known.
    """

    def __init__(self, skill: Skill, source: FrameSource, total: int | None) -> None:
        self.frames = 0
        self._source = source.name
        self._skill = skill
        self._definition = TaskDefinition(skill.members)
        self._errors = ErrorHistory(total)
        self._history: list[tuple[int, str, float, float]] = []
        self._first: tuple[Frame, InferenceResult] | None = None
        self._end = EndOfTask()

    def overlay(
        self, frame: Frame, result: InferenceResult, min_drawn_weight: float
    ) -> UInt8[np.ndarray, "height width 3"]:
        """Draw what was selected in the next frame."""
        self._errors.add(result)
        return draw_overlay(
            frame.image,
            result,
            frame_index=frame.index,
            time_s=frame.time_s,
            title=Path(self._source).name,
            minimum_weight=min_drawn_weight,
            history=self._errors,
        )

    def add(self, frame: Frame, result: InferenceResult) -> None:
        """Take in what was selected in a frame."""
        self._definition.add(frame.index, result, frame.image)
        for association in result.associations:
            if association.rank == 1:
                norm = float(np.linalg.norm(association.error))
                self._history.append((frame.index, association.member, association.confidence, norm))
        if result.associations:
            self._first = self._first or (frame, result)
        self._end.add(frame, result)
        self.frames += 1

    def write(self, folder: Path, metrics: Mapping[str, Any]) -> dict[str, Any]:
        """Write task definition, metrics and plot; return the metrics, with those given where the names are new."""
        decidability = self._end.decidability(self._skill)
        own: dict[str, Any] = {
            "source": self._source,
            "frames": self.frames,
            "frames_with_association": len({row[0] for row in self._history}),
            "mean_confidence": float(np.mean([row[2] for row in self._history])) if self._history else None,
        }
        summary = {**own, **metrics, **own, "decidability": decidability}
        (folder / FOLDER).mkdir(exist_ok=True)
        for path, crop, node in self._definition.pictures():
            write_picture(folder / path, draw_crop(crop, node))
        for name, end in (("first.jpg", self._first), ("last.jpg", self._end.seen)):
            if end is not None:
                write_picture(folder / FOLDER / name, draw_associations(end[0].image, end[1]))
        described = {
            "source": self._source,
            **chosen(self._skill),
            **self._definition.as_dict(),
            "decidability": decidability,
        }
        with atomic_open(folder / "skill.yaml") as file:
            file.write(EDITING)
            yaml.safe_dump(described, file, sort_keys=False, default_flow_style=None, width=120)
        with atomic_open(folder / "metrics.json") as file:
            json.dump(summary, file, indent=2)
        plot_inference(self._history, folder / "inference.png")
        return summary


def chosen(skill: Skill) -> dict[str, Any]:
    """Return under ``auto`` which members the demonstration chose; nothing where they were named."""
    choice = skill.provenance.choice
    return {} if choice is None else {"auto": choice.as_plain()}


def extracted_ahead(
    skill: Skill, frames: Iterable[Frame], threads: int, *, live: bool
) -> Generator[tuple[Frame, dict[str, FeatureSet]], None, None]:
    """Yield frames with their features, which are read and extracted ahead of their use; close it after use.

    Args:
        skill: has the extractors.
        frames: one after the other; may be endless.
        threads: how many are worked on at once; see :func:`~geoskill.io.prefetch.prefetch_map`.
        live: no more than one frame is ahead, so that what is selected is never older than the work on two frames
            takes. Where that takes longer than the camera, the driver keeps a few pictures, and drops the others.
    """

    def extract(frame: Frame) -> tuple[Frame, dict[str, FeatureSet]]:
        return frame, skill.extract(frame.image, frame.depth)

    return prefetch_map(extract, frames, threads=threads, max_prefetch=1 if live else None)


def association_lines(
    frame: Frame, result: InferenceResult, members: Mapping[str, KernelModel]
) -> Iterator[dict[str, Any]]:
    """Yield the lines of ``associations.jsonl`` for one frame; a member without associations has a line of rank 0.

    What is said of a member, such as its state, is on all of its lines.
    """
    place = {"frame": frame.index, "time_s": round(frame.time_s, 6)}
    for association in result.associations:
        yield {**place, **association.as_json(), **result.members[association.member].as_json()}
    for name, reason in result.reasons.items():
        yield {
            **place,
            "kernel": members[name].kernel.name,
            "descriptor": members[name].descriptor,
            "rank": 0,
            "confidence": 0.0,
            "nodes": [],
            "error": [],
            "error_std": [],
            **result.members[name].as_json(),
            "reason": reason,
        }
