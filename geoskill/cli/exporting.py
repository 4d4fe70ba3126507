"""``export=``: the files for other programs, of frames in which a skill selects."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

from geoskill.control.camera_motion import constant_depth
from geoskill.exports.exporter import Exporter, Exports, open_exports
from geoskill.exports.intrinsics import IntrinsicMotion, measured_depth
from geoskill.exports.record import frame_record
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.io.camera_file import read_camera_file
from geoskill.io.frames import Frame
from geoskill.skill.association import InferenceResult
from geoskill.skill.skill import Skill


@final
class FrameExports:
    """Exports of the frames of one recording.

    Args:
        skill: that selects.
        exports: that take the records.
        camera: intrinsics; None for those of frames with depth, if any.
        depth_m: rough depth of what has none, meters.
    """

    def __init__(self, skill: Skill, exports: Exports, camera: DepthCamera | None, depth_m: float) -> None:
        self._skill, self._exports, self._camera, self._depth_m = skill, exports, camera, depth_m

    def add(self, frame: Frame, result: InferenceResult, lines: Sequence[Mapping[str, Any]]) -> None:
        """Take in what was selected in a frame.

        Args:
            frame: the next one.
            result: of it.
            lines: of ``associations.jsonl``.
        """
        motion = self.motion(frame)
        record = frame_record(frame.index, frame.time_s, self._skill, result, motion)
        self._exports.add(record, lines, motion)

    def motion(self, frame: Frame) -> IntrinsicMotion | None:
        """Return the field of the frame's camera, where its intrinsics are known."""
        depth = frame.depth
        camera = self._camera or (None if depth is None else depth.camera)
        if camera is None:
            return None
        rough = constant_depth(self._depth_m)
        return IntrinsicMotion(camera, rough if depth is None else measured_depth(depth, self._depth_m))


@contextmanager
def open_frame_exports(
    skill: Skill, exporters: Sequence[Exporter], intrinsics: str | None, depth_m: float
) -> Iterator[FrameExports]:
    """Begin the exports of a recording, which are complete at the end of the block.

    Args:
        skill: that selects.
        exporters: of the files that are wanted.
        intrinsics: file of the camera's intrinsics, or None.
        depth_m: rough depth of what has none, meters.

    Raises:
        InputError: when the file of intrinsics cannot be read.
    """
    camera = None if intrinsics is None else read_camera_file(Path(intrinsics)).color
    with open_exports(exporters) as exports:
        yield FrameExports(skill, exports, camera, depth_m)
