"""Tasks of ViSP from the features of a frame, where its Python bindings are installed.

``visp`` is built from ViSP's sources; the package index has none. Its classes drop the ``vp`` of C++. Signs: a task of
``EYEINHAND_CAMERA`` makes s fall with the velocity of which L is the derivative, which here is the carried thing's, in
the axes of ``twist_frame``. ``FeaturePoint`` and ``FeatureLine`` bring the L of a moving camera; for a camera at rest
that looks at the moved thing, ``EYETOHAND_L_cVe_eJe`` takes its negative. With identities in place of cVe and eJe, the
velocity is the carried thing's in the camera's axes; with the robot's own, it is that of its joints. Source: ViSP's
documentation of ``vpServo``, ``vpGenericFeature``, ``vpFeaturePoint`` and ``vpFeatureLine``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from geoskill.errors import InputError


def _bindings() -> tuple[Any, Any, Any]:
    """Return the modules of ViSP's bindings: core, visual features, visual servoing.

    Raises:
        InputError: when they are not installed.
    """
    try:
        from visp import core, visual_features, vs
    except ImportError:
        raise InputError(
            "visp is not installed; expected ViSP's Python bindings, built from its sources (https://visp.inria.fr)"
        ) from None
    return core, visual_features, vs


def generic_task(frame: Mapping[str, Any], gain: float = 0.5) -> tuple[Any, list[Any]]:
    """Return a task of generic features, one for each row that is to be used, and the features, to be kept as long.

    ``task.computeControlLaw()`` is the twist of the carried thing in the axes of ``twist_frame``.

    Args:
        frame: an entry of ``frames`` of ``visp_features.json``.
        gain: lambda of the control law, per second.

    Raises:
        InputError: when ViSP is not installed, or a row has no Jacobian.
    """
    core, visual_features, vs = _bindings()
    task = vs.Servo()
    task.setServo(vs.Servo.EYEINHAND_CAMERA)
    task.setInteractionMatrixType(vs.Servo.CURRENT)
    task.setLambda(gain)
    features = []
    for row in frame["features"]:
        if row["weight"] <= 0:
            continue
        if row["L"] is None:
            raise InputError(
                f"frame {frame['frame']} has no L; expected an export with intrinsics=FILE, or of servo.py"
            )
        root = row["weight"] ** 0.5  # the law is one of least squares
        feature = visual_features.GenericFeature(row["dim"])
        feature.set_s(core.ColVector(root * np.array(row["s"], np.float64)))
        feature.setInteractionMatrix(core.Matrix(root * np.array(row["L"], np.float64)))
        task.addFeature(feature)  # whose desired value is zero
        features.append(feature)
    return task, features


def picture_task(frame: Mapping[str, Any], gain: float = 0.5) -> tuple[Any, list[Any]]:
    """Return a task of ViSP's own points and lines, with their desired ones, and these features, to be kept as long.

    It is for a camera at rest; cVe and eJe are identities, so that the velocity is that of the carried thing in the
    camera's axes. Set those of a robot with ``set_cVe`` and ``set_eJe``.

    Args:
        frame: an entry of ``frames`` of ``visp_features.json``.
        gain: lambda of the control law, per second.

    Raises:
        InputError: when ViSP is not installed, or no row is a point or a line.
    """
    core, visual_features, vs = _bindings()
    task = vs.Servo()
    task.setServo(vs.Servo.EYETOHAND_L_cVe_eJe)
    task.setInteractionMatrixType(vs.Servo.CURRENT)
    task.setLambda(gain)
    task.set_cVe(core.VelocityTwistMatrix())
    task.set_eJe(core.Matrix(np.eye(6)))
    kept = []
    for row in frame["features"]:
        if row["weight"] <= 0:
            continue
        present = desired = None
        if "point" in row:
            own = row["point"]
            present, desired = visual_features.FeaturePoint(), visual_features.FeaturePoint()
            present.set_xyZ(own["x"], own["y"], own["Z"])
            desired.set_xyZ(own["xd"], own["yd"], own["Z"])
        elif "line" in row:
            own = row["line"]
            present, desired = visual_features.FeatureLine(), visual_features.FeatureLine()
            for feature, end in ((present, ""), (desired, "_d")):
                feature.setRhoTheta(own[f"rho{end}"], own[f"theta{end}"])
                feature.setABCD(*own["plane"])
        if present is not None:
            task.addFeature(present, desired)
            kept += [present, desired]
    if not kept:
        raise InputError(f"frame {frame['frame']} has no point and no line; expected an export with intrinsics=FILE")
    return task, kept
