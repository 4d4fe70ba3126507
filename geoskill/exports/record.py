"""The neutral record of a frame: plain values for JSON, of which every export is a view.

::

    {"frame": 12, "time_s": 0.4, "state": "observe", "reason": "",
     "rows": [{"member": "p2p_sift", "kernel": "p2p", "rank": 1, "camera": 0, "error": [26.3, -74.9], "target": null,
               "jacobian": null, "weight": 1.0, "confidence": 0.93, "nodes": [[101.5, 66.0], [75.2, 140.9]],
               "carried": [true, false]}],
     "dof": [], "twist_frame": null, "twist": null, "predicted_mm": null, "rank": 0, "rms_px": null, "notes": []}

``error`` is what is to become zero, in pixels or units of the kernel's resolution: the control error less ``target``,
its value at the goal where that is known. ``jacobian`` is its derivative with respect to the carried thing's twist, the
components of which are named by ``dof``, in the axes of ``twist_frame``: ``base``, those of the robot's base, about the
grip; or ``camera``, those of the camera, about its center. A row of weight 0 is not to be used.
"""

from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from geoskill.control.action import ActionSpace, Dof, names
from geoskill.control.image_motion import ImageMotion, StillMotion
from geoskill.control.rows import rows_of
from geoskill.control.state import Record, rounded, row_as_json
from geoskill.skill.association import InferenceResult
from geoskill.skill.servoing import constraints_of
from geoskill.skill.skill import Skill

NeutralRecord = dict[str, Any]
OBSERVE: Final = "observe"
"""State of a record where nothing is commanded."""
BASE, CAMERA = "base", "camera"
PAIRS: Final = "p2p"
"""Kernel whose error is the way from where a point is to be to where it is."""


def step_record(record: Record, space: ActionSpace, rate_hz: float) -> NeutralRecord:
    """Return the neutral record of a step of the loop, with the action beside its twist.

    Args:
        record: of the step.
        space: what is commanded.
        rate_hz: steps per second.
    """
    action = rounded(record.decision.action, 6)
    return {**record.as_json(space, rate_hz), "twist_frame": BASE, "action": action}


def frame_record(
    frame: int, time_s: float, skill: Skill, result: InferenceResult, motion: ImageMotion | None = None
) -> NeutralRecord:
    """Return the neutral record of a frame in which a skill selected, with the rows by which the loop would drive.

    Args:
        frame: number of the frame.
        time_s: of the frame, seconds.
        skill: that selected.
        result: of the frame.
        motion: field over the twist of the camera's frame (:class:`~geoskill.exports.intrinsics.IntrinsicMotion`);
            None where the camera is not known, so that there are no Jacobians.
    """
    constraints = constraints_of(skill, result)
    rows = []
    for row in rows_of(constraints, [StillMotion(len(Dof)) if motion is None else motion]):
        status = result.members[row.constraint.member]
        certain = status.error_is_certain if row.constraint.target is None else status.goal_error_is_certain
        one_moves = any(row.constraint.carried) and not all(row.constraint.carried)
        finite = bool(np.isfinite(row.error).all() and np.isfinite(row.jacobian).all())
        line = row_as_json(row, float(certain and one_moves and finite))
        rows.append(line if motion is not None else {**line, "jacobian": None})
    return {
        "frame": frame,
        "time_s": round(time_s, 6),
        "state": OBSERVE,
        "reason": "",
        "rows": rows,
        "dof": [] if motion is None else names(list(Dof)),
        "twist_frame": None if motion is None else CAMERA,
        "twist": None,
        "predicted_mm": None,
        "rank": 0,
        "rms_px": None,
        "notes": [],
    }


def full_jacobian(record: Mapping[str, Any], row: Mapping[str, Any]) -> list[list[float]] | None:
    """Return the Jacobian of a row over all six components of a twist, zeros where one is not commanded.

    Args:
        record: that has the row.
        row: of it.
    """
    if row["jacobian"] is None:
        return None
    columns = [list(Dof).index(Dof(name)) for name in record["dof"]]
    full = np.zeros((len(row["jacobian"]), len(Dof)))
    full[:, columns] = row["jacobian"]
    return [list(map(float, line)) for line in full]


def point_pair(row: Mapping[str, Any]) -> tuple[list[float], list[float]] | None:
    """Return the pixels at which a row's carried point is, and is to be; None for what is no pair of points.

    Args:
        row: of a record.
    """
    if row["kernel"] != PAIRS or sum(row["carried"]) != 1:
        return None
    carried = row["carried"].index(True)
    here = row["nodes"][carried]
    sign = 1.0 if carried == 0 else -1.0  # the error is the first node less the second
    return list(here), [at - sign * error for at, error in zip(here, row["error"], strict=True)]
