"""Whether constraints determine where the carried thing goes, and what they leave free.

Two questions. *Is the pose determined?* The rank of the Jacobian of all rows with respect to the thing's twist, at a
goal at which they hold, with the directions that are left free by name, and those that are determined badly. *Is the
task decidable?* Zero in the pictures must mean done in space (Hespanha, Dodds, Hager and Morse, IJCV 1999): two cameras
decide what is projectively invariant, one camera decides nothing by itself, but a rigid thing with three points not on
a line is determined all the same.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import UPRIGHT, Dof
from geoskill.control.free_motions import name_free_motions, name_of, null_space
from geoskill.control.placed import COPLANAR, SCALE, Placed, picture_rows, space_rows
from geoskill.geometry.camera import PinholeCamera

WEAK_MM: Final = 10.0
WEAK_DEG: Final = 5.0


@final
@dataclass(frozen=True)
class Determination:
    """What one way of looking determines.

    Attributes:
        rank: degrees of freedom that are determined.
        of: degrees of freedom that there are.
        free: names of the motions that are left free.
        weak: names of directions that are determined badly, with the standard deviation in mm and degrees.
    """

    rank: int
    of: int
    free: tuple[str, ...]
    weak: tuple[tuple[str, float, float], ...]

    def as_text(self) -> str:
        """Return one line."""
        parts = [f"determined: {self.rank} of {self.of}"]
        if self.free:
            parts.append(f"free: {', '.join(self.free)}")
        if self.weak:
            parts.append("weak: " + ", ".join(f"{name} ({mm:.0f} mm, {deg:.1f}°)" for name, mm, deg in self.weak))
        return " | ".join(parts)


@final
@dataclass(frozen=True)
class Decidability:
    """The report on a set of constraints.

    Attributes:
        one_camera: what one camera determines of x, y, z and the turn about the vertical.
        two_cameras: what two cameras determine of them.
        depth: what positions in space determine of them; None where a kernel says nothing in space.
        all_axes: ranks over all six degrees of freedom: one camera, two cameras, depth.
        statement: whether zero in the pictures means done in space.
    """

    one_camera: Determination
    two_cameras: Determination
    depth: Determination | None
    all_axes: tuple[int, int, int | None]
    statement: str

    def as_plain(self) -> dict[str, Any]:
        """Return the report as plain values, to be written to files."""

        def plain(own: Determination | None) -> dict[str, Any] | None:
            if own is None:
                return None
            weak = [{"motion": name, "mm": round(mm, 1), "deg": round(deg, 2)} for name, mm, deg in own.weak]
            return {"determined": own.rank, "of": own.of, "free": list(own.free), "weak": weak}

        return {
            "one_camera": plain(self.one_camera),
            "two_cameras": plain(self.two_cameras),
            "depth": plain(self.depth),
            "all_six_axes": list(self.all_axes),
            "decidable": self.statement,
        }

    def as_text(self) -> str:
        """Return the report for one camera as one line."""
        return f"{self.one_camera.as_text()} | decidable: {self.statement}"


def decidability(placed: Sequence[Placed], cameras: tuple[PinholeCamera, PinholeCamera]) -> Decidability:
    """Return the report on constraints that hold, seen by one or both of two cameras.

    Args:
        placed: at least one constraint.
        cameras: the camera, and a second one.

    Raises:
        ValueError: when there is no constraint.
    """
    if not placed:
        raise ValueError("no constraint; expected at least one")
    grip = np.mean(np.concatenate([own.nodes[node] for own in placed for node in own.moving]), axis=0)
    views = [picture_rows(placed, camera, grip) for camera in cameras]
    space = space_rows(placed, grip)
    directions, points = _names(placed, cameras[0])

    def determined(rows: Float64[np.ndarray, "r 6"]) -> Determination:
        return determination(rows, UPRIGHT, grip, directions, points)

    ranks = [rank_of(views[0]), rank_of(np.concatenate(views)), None if space is None else rank_of(space)]
    return Decidability(
        determined(views[0]),
        determined(np.concatenate(views)),
        None if space is None else determined(space),
        (int(ranks[0] or 0), int(ranks[1] or 0), ranks[2]),
        statement_on(placed, rank_of(views[0])),
    )


def rank_of(rows: Float64[np.ndarray, "r c"]) -> int:
    """Return the number of singular values that are not negligible."""
    return rows.shape[1] - null_space(rows).shape[1] if np.any(rows) else 0


def determination(
    rows: Float64[np.ndarray, "r 6"],
    dofs: Sequence[Dof],
    grip: Float64[np.ndarray, "3"],
    directions: Mapping[str, Float64[np.ndarray, "3"]],
    points: Mapping[str, Float64[np.ndarray, "3"]],
) -> Determination:
    """Return rank, free motions and weak directions over some degrees of freedom.

    Args:
        rows: with respect to the scaled twist.
        dofs: that the actor has.
        grip: about which the twist turns.
        directions: that have names.
        points: that have names.
    """
    columns = [list(Dof).index(dof) for dof in dofs]
    others = [column for column in range(6) if column not in columns]
    # What the actor cannot do is as good as forbidden.
    forbidden = np.eye(6)[others] * max(float(np.abs(rows).max(initial=0.0)), 1.0)
    closed = np.concatenate([rows, forbidden]) / SCALE
    free = name_free_motions(closed * np.array([1.0] * 3 + [0.1] * 3), grip, directions, points)
    own = rows[:, columns]
    rank = rank_of(own)
    _, values, axes = np.linalg.svd(own) if len(own) else (None, np.zeros(0), np.eye(len(columns)))
    weak = []
    for value, axis in zip(values[:rank], axes, strict=False):
        twist = np.zeros(6)
        twist[columns] = axis
        twist = twist * SCALE * np.sqrt(2.0) / value
        mm, deg = 1000 * float(np.linalg.norm(twist[:3])), float(np.degrees(np.linalg.norm(twist[3:])))
        if mm > WEAK_MM or deg > WEAK_DEG:
            weak.append((_weak_name(twist, directions), mm, deg))
    return Determination(rank, len(columns), free, tuple(weak))


def statement_on(placed: Sequence[Placed], rank: int) -> str:
    """Return whether zero in the pictures means done in space.

    Args:
        placed: the constraints.
        rank: over all six degrees of freedom, by one camera.
    """
    names = {own.name for own in placed}
    notes = []
    if "par" in names:
        notes.append("par only where the lines are at one depth")
    if COPLANAR in names:
        notes.append("copl only with known epipolar geometry or depth")
    points = sum(own.name == "p2p" for own in placed)
    if rank == 6 and points >= 3:
        first = "with one camera, as the thing is rigid" + ("" if points >= 4 else ", up to one other pose")
    elif names <= {"par", COPLANAR}:
        first = "in space only"
    else:
        first = "with two cameras; one camera's zero is necessary, not sufficient"
    return "; ".join([first, *notes])


def _names(
    placed: Sequence[Placed], camera: PinholeCamera
) -> tuple[dict[str, Float64[np.ndarray, "3"]], dict[str, Float64[np.ndarray, "3"]]]:
    """Return the directions and the points that have names."""
    directions = {"the vertical": np.array([0.0, 0.0, 1.0])}
    points: dict[str, Float64[np.ndarray, 3]] = {}
    counts: dict[str, int] = {}
    for own in placed:
        counts[own.name] = number = counts.get(own.name, 0) + 1
        label = own.name if sum(other.name == own.name for other in placed) == 1 else f"{own.name} {number}"
        for node in own.nodes:
            if len(node) == 2:
                along = node[1] - node[0]
                directions.setdefault(f"the line of {label}", along / np.linalg.norm(along))
                points.setdefault(f"the line of {label}", node.mean(axis=0))
            elif own.name != COPLANAR:
                points.setdefault(f"the point of {label}", node[0])
    directions["the line of sight"] = camera.pose[:3, 2]
    return directions, points


def _weak_name(twist: Float64[np.ndarray, "6"], directions: Mapping[str, Float64[np.ndarray, "3"]]) -> str:
    shift, turn = twist[:3], twist[3:]
    if np.linalg.norm(shift) / SCALE[0] >= np.linalg.norm(turn) / SCALE[3]:
        return name_of(shift, {"the line of sight": directions["the line of sight"], **directions})
    return f"turn about {name_of(turn, directions)}"
