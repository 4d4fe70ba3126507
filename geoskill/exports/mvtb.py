"""Pairs of points for the Machine Vision Toolbox for Python: ``mvtb.npz``.

Arrays over all pairs of all frames: ``uv`` [2, N] where the carried point is and ``uv_d`` [2, N] where it is to be,
pixels; ``frame`` [N], ``time_s`` [N], ``weight`` [N], ``member`` [N]; and, where the camera is known, ``Z`` [N], its
depth in meters, and ``K`` [3, 3]. They are what ``CentralCamera.visjac_p(uv, Z)`` takes, whose Jacobian is of the
camera's spatial velocity: the carried thing, seen by a camera at rest, moves by its negative. Source: P. Corke,
Robotics, Vision and Control, 3rd edition, section 15.2, and the toolbox's documentation of ``visjac_p``.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, final

import numpy as np

from geoskill.exports.exporter import Exporter
from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.record import NeutralRecord, point_pair
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.io.atomic import atomic_open

FILE: Final = "mvtb.npz"


@final
class ToolboxExporter(Exporter):
    """Writes the pairs of points of the first camera.

    Args:
        folder: of the run.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE
        self._pairs: list[tuple[float, ...]] = []
        self._members: list[str] = []
        self._camera: DepthCamera | None = None

    def __enter__(self) -> "ToolboxExporter":
        """Begin; nothing is written before the end."""
        return self

    def add(
        self,
        record: NeutralRecord,
        associations: Sequence[Mapping[str, Any]] = (),
        motion: IntrinsicMotion | None = None,
    ) -> None:
        """See :meth:`Exporter.add`."""
        self._camera = self._camera if motion is None else motion.camera
        for row in record["rows"]:
            pair = point_pair(row)
            if pair is None or row["camera"] != 0:
                continue
            here, there = pair
            depth = np.nan if motion is None else float(motion.depth_of(np.array([here]))[0])
            self._pairs.append((*here, *there, depth, record["frame"], record["time_s"], row["weight"]))
            self._members.append(row["member"])

    def __exit__(self, *error: object) -> None:
        """Write the file, unless there was an error."""
        if error[0] is not None:
            return
        table = np.array(self._pairs, np.float64).reshape(-1, 8)
        arrays: dict[str, np.ndarray] = {
            "uv": table[:, :2].T,
            "uv_d": table[:, 2:4].T,
            "frame": table[:, 5].astype(np.int64),
            "time_s": table[:, 6],
            "weight": table[:, 7],
            "member": np.array(self._members, np.str_),
        }
        if self._camera is not None:
            arrays |= {"Z": table[:, 4], "K": matrix(self._camera)}
        with atomic_open(self._path, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]  # numpy's own keyword is a bool


def matrix(camera: DepthCamera) -> np.ndarray:
    """Return the matrix K of intrinsics, [3, 3].

    >>> matrix(DepthCamera(500.0, 400.0, 320.0, 240.0)).tolist()
    [[500.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]]
    """
    return np.array(
        [[camera.focal_x_px, 0.0, camera.center_x_px], [0.0, camera.focal_y_px, camera.center_y_px], [0.0, 0.0, 1.0]]
    )
