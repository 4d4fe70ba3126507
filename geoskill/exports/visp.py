"""Features for ViSP (https://visp.inria.fr): ``visp_features.json``.

A frame's features are rows of its record. ``s`` is what is to become zero; ``L`` [d, 6] its derivative with respect to
the twist (v, w) of the *carried thing*, in the axes of ``twist_frame``, zeros where a component is not commanded.
Where the camera is known, a pair of points has ``point``: its normalized coordinates x, y, those at the goal xd, yd,
and the depth Z; and a pair of lines without a goal of its own has ``line``: rho and theta of x cos(theta) + y
sin(theta) = rho, at present and as desired, and the plane A, B, C, D at that depth. :mod:`geoskill.exports.visp_tasks`
makes ``visp.vs.Servo`` of them.
"""

import json
import math
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, Final, final

import numpy as np

from geoskill.exports.exporter import Exporter, finite
from geoskill.exports.intrinsics import IntrinsicMotion, normalized
from geoskill.exports.record import NeutralRecord, full_jacobian, point_pair
from geoskill.io.atomic import atomic_open

FILE: Final = "visp_features.json"
VERSION: Final = 1
LINES: Final = "l2l"


@final
class VispExporter(Exporter):
    """Writes the features of each frame as they come.

    Args:
        folder: of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._stack = ExitStack()
        self._file: IO[str] | None = None
        self._camera: dict[str, float] | None = None
        self._frames = 0

    def __enter__(self) -> "VispExporter":
        """Begin the file."""
        self._file = self._stack.enter_context(atomic_open(self._path))
        self._file.write(f'{{"version": {VERSION}, "frames": [\n')
        return self

    def add(
        self,
        record: NeutralRecord,
        associations: Sequence[Mapping[str, Any]] = (),
        motion: IntrinsicMotion | None = None,
    ) -> None:
        """See :meth:`Exporter.add`."""
        if self._file is None:
            raise ValueError("the export has not begun; expected a with statement")
        if motion is not None:
            camera = motion.camera
            names = ("fx", "fy", "cx", "cy")
            values = (camera.focal_x_px, camera.focal_y_px, camera.center_x_px, camera.center_y_px)
            self._camera = dict(zip(names, values, strict=True))
        self._file.write(("" if self._frames == 0 else ",\n") + json.dumps(features_of(record, motion)))
        self._frames += 1

    def __exit__(self, *error: Any) -> None:
        """End the file, or leave nothing after an error."""
        if self._file is not None and error[0] is None:
            self._file.write(f'\n], "camera": {json.dumps(self._camera)}}}\n')
        self._stack.__exit__(*error)


def features_of(record: NeutralRecord, motion: IntrinsicMotion | None = None) -> dict[str, Any]:
    """Return the features of a frame.

    Args:
        record: of the frame.
        motion: field of the camera; None where it is not known.
    """
    features = []
    for row in record["rows"]:
        feature = {
            **{key: row[key] for key in ("member", "kernel", "rank", "camera", "weight", "confidence")},
            "dim": len(row["error"]),
            "s": row["error"],
            "L": full_jacobian(record, row),
        }
        if motion is not None:
            feature |= _by_intrinsics(row, motion)
        features.append(feature)
    own = {key: record[key] for key in ("frame", "time_s", "state", "twist_frame")}
    described: dict[str, Any] = finite({**own, "features": features})
    return described


def _by_intrinsics(row: Mapping[str, Any], motion: IntrinsicMotion) -> dict[str, Any]:
    """Return a row as ViSP's own features of points or lines, where it is one."""
    pair = point_pair(row)
    if pair is not None:
        here, there = normalized(motion.camera, np.array(pair)).tolist()
        depth = float(motion.depth_of(np.array(pair[:1]))[0])
        return {"point": {"x": here[0], "y": here[1], "xd": there[0], "yd": there[1], "Z": depth}}
    if row["kernel"] != LINES or row["target"] is not None or sum(row["carried"]) != 1:
        return {}
    carried = row["carried"].index(True)
    ends, resting = (np.array(row["nodes"][node]).reshape(2, 2) for node in (carried, 1 - carried))
    if np.ptp(ends, axis=0).max() == 0 or np.ptp(resting, axis=0).max() == 0:
        return {}
    here, there = polar_line(normalized(motion.camera, ends)), polar_line(normalized(motion.camera, resting))
    if math.cos(here[1] - there[1]) < 0:  # the same line, written with the other normal
        there = (-there[0], math.remainder(there[1] + math.pi, 2 * math.pi))
    depth = float(motion.depth_of(ends).mean())
    rho, theta = here
    return {"line": {"rho": rho, "theta": theta, "rho_d": there[0], "theta_d": there[1], "plane": [0, 0, 1, -depth]}}


def polar_line(ends: np.ndarray) -> tuple[float, float]:
    """Return rho and theta of the line x cos(theta) + y sin(theta) = rho through two points.

    >>> [round(value, 3) for value in polar_line(np.array([[0.0, 2.0], [1.0, 2.0]]))]
    [2.0, 1.571]

    Args:
        ends: of a segment, [2, 2], not the same.
    """
    along = ends[1] - ends[0]
    normal = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return float(normal @ ends[0]), math.atan2(normal[1], normal[0])
