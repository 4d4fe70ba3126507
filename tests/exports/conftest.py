"""A skill that selects, a camera, and the record of a frame in which everything is known."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from geoskill.control.camera_motion import constant_depth
from geoskill.control.image_motion import ImageMotion
from geoskill.control.rows import Constraint, rows_of
from geoskill.control.state import row_as_json
from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.record import NeutralRecord
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2p import PointToPoint

CAMERA = DepthCamera(600.0, 610.0, 318.0, 242.0)
DEPTH_M = 0.7
P2P, L2L = PointToPoint(), LineToLine()


def constraint(kernel: Kernel, nodes: Sequence[Sequence[float]], **fields: Any) -> Constraint:
    own = tuple(np.array(node, np.float64) for node in nodes)
    return Constraint(kernel, own, fields.pop("carried", (True, False)), **{"member": "m", **fields})


@pytest.fixture
def motion() -> IntrinsicMotion:
    """The field of a calibrated camera, everything 0.7 m away."""
    return IntrinsicMotion(CAMERA, constant_depth(DEPTH_M))


@pytest.fixture
def record_of(motion: IntrinsicMotion) -> Callable[..., NeutralRecord]:
    """``record_of(constraint, ...)`` is the record of a frame with these constraints."""

    def record(*constraints: Constraint, field: ImageMotion = motion, **fields: Any) -> NeutralRecord:
        rows = [row_as_json(row, 1.0) for row in rows_of(constraints, [field])]
        own = {"frame": 3, "time_s": 0.1, "state": "observe", "reason": "", "rows": rows, "twist_frame": "camera"}
        dof = ["x", "y", "z", "roll", "pitch", "yaw"]
        return {**own, "dof": dof, "twist": None, **fields}

    return record


@pytest.fixture
def scene() -> tuple[Constraint, ...]:
    """Four pairs of points, one of them the other way round and one with a goal of its own, and a pair of lines."""
    return (
        constraint(P2P, [(101.5, 66.0), (75.2, 140.9)]),
        constraint(P2P, [(400.0, 300.0), (420.0, 310.0)], carried=(False, True)),
        constraint(P2P, [(250.0, 90.0), (260.0, 99.0)], target=(4.0, -2.0), member="n"),
        constraint(P2P, [(350.0, 390.0), (310.0, 350.0)], rank=2),
        constraint(L2L, [(100.0, 100.0, 180.0, 120.0), (110.0, 160.0, 190.0, 170.0)], member="l"),
    )
