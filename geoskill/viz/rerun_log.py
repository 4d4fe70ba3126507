"""A recording for rerun (https://rerun.io): frames, features, associations, errors and states, to be looked at in time.

::

    camera                      picture; depth where there is any
    camera/features/SIFT        points or line segments
    camera/associations/MEMBER  a segment between the nodes of the top association
    error/MEMBER.ROW            the error's rows; goal_error/MEMBER.ROW likewise
    confidence/MEMBER           of the top association
    state/MEMBER                a line of text whenever it changes
"""

from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Final, final

import numpy as np

from geoskill.errors import InputError, missing_extra
from geoskill.io.frames import Frame
from geoskill.skill.association import Association, InferenceResult

if TYPE_CHECKING:
    pass

RECORDING: Final = "recording.rrd"
JPEG_QUALITY = 85
# Numbers of coordinates of points and of segments; planes and conics are left out.
IN_PICTURE = (2, 4)
RED, YELLOW = (230, 30, 40), (250, 220, 80)


@final
class RerunLog:
    """Writes what is selected in each frame; a context, at whose end the file is complete.

    Args:
        folder: of the run; the file is :data:`RECORDING` in it.
        live: show it in rerun's viewer while it is made, instead of writing a file.
        title: of the recording.

    Raises:
        InputError: when rerun is not installed, or its viewer cannot be started.
    """

    def __init__(self, folder: Path, *, live: bool, title: str) -> None:
        try:
            import rerun
        except ImportError:
            raise missing_extra("rerun=true", "rerun") from None
        self._rerun = rerun
        self._stream: rerun.RecordingStream = rerun.RecordingStream("geoskill", recording_id=title)
        self._states: dict[str, str] = {}
        try:
            if live:
                self._stream.spawn()
            else:
                self._stream.save(folder / RECORDING)
        except RuntimeError as error:
            expected = "a display for its viewer, or rerun=true for a file" if live else "a folder that can be written"
            raise InputError(f"rerun: {' '.join(str(error).split())}; expected {expected}") from error

    def __enter__(self) -> "RerunLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._stream.flush()
        self._stream.disconnect()

    def add(self, frame: Frame, result: InferenceResult) -> None:
        """Take in a frame and what was selected in it."""
        log, archetypes = self._stream.log, self._rerun
        self._stream.set_time("frame", sequence=frame.index)
        self._stream.set_time("time", duration=frame.time_s)
        log("camera", archetypes.Image(frame.image).compress(jpeg_quality=JPEG_QUALITY))
        if frame.depth_m is not None:
            log("camera/depth", archetypes.DepthImage(np.nan_to_num(frame.depth_m).astype(np.float32), meter=1.0))
        for name, features in result.features.items():
            if features.geometry.shape[1] not in IN_PICTURE:
                continue
            strips = features.geometry.reshape(len(features), -1, 2)
            if strips.shape[1] == 1:
                log(f"camera/features/{name}", archetypes.Points2D(strips[:, 0], colors=YELLOW, radii=1.5))
            else:
                log(f"camera/features/{name}", archetypes.LineStrips2D(strips, colors=YELLOW))
        tops = {own.member: own for own in result.associations if own.rank == 1}
        for member, status in result.members.items():
            self._add_top(member, tops.get(member))
            if self._states.get(member) != str(status.state):
                self._states[member] = str(status.state)
                log(f"state/{member}", archetypes.TextLog(str(status.state)))
        rows = [row for status in result.members.values() for row in status.rows]
        for kind, values in (("error", result.error), ("goal_error", result.goal_error)):
            for row, value in zip(rows, values, strict=True):
                if np.isfinite(value):
                    log(f"{kind}/{row}", archetypes.Scalars(float(value)))

    def _add_top(self, member: str, top: Association | None) -> None:
        path = f"camera/associations/{member}"
        if top is None:
            self._stream.log(path, self._rerun.Clear(recursive=False))
            return
        nodes = [np.reshape(node.coordinates, (-1, 2)) for node in top.nodes if len(node.coordinates) in IN_PICTURE]
        if nodes:
            strips = [np.stack([node.mean(axis=0) for node in nodes]), *(node for node in nodes if len(node) > 1)]
            self._stream.log(path, self._rerun.LineStrips2D(strips, colors=RED, radii=1.0))
        self._stream.log(f"confidence/{member}", self._rerun.Scalars(top.confidence))
