"""What a run says of its members over time: the lines of ``associations.jsonl`` as arrays."""

import json
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float64, Int64


@final
@dataclass(frozen=True, eq=False)
class MemberCurves:
    """One member over the frames of a video.

    Attributes:
        name: of the member.
        unit: of its error; empty for an error without unit.
        rows: names of the rows of its error.
        frame: number of each frame.
        time_s: seconds after the first frame.
        error: control error of the top association; NaN where there is none.
        goal_norm: norm of the goal error; NaN where there is none.
        confidence: of the top association; 0 where there is none.
        state: the words of the files.
        is_certain: whether the gate of the error is open (:mod:`geoskill.skill.innovation`).
        switched: whether another association was selected than in the frame before.
    """

    name: str
    unit: str
    rows: tuple[str, ...]
    frame: Int64[np.ndarray, " n"]
    time_s: Float64[np.ndarray, " n"]
    error: Float64[np.ndarray, "n d"]
    goal_norm: Float64[np.ndarray, " n"]
    confidence: Float64[np.ndarray, " n"]
    state: tuple[str, ...]
    is_certain: Bool[np.ndarray, " n"]
    switched: Bool[np.ndarray, " n"]

    @property
    def norm(self) -> Float64[np.ndarray, " n"]:
        """Norm of the error; NaN where there is none."""
        return np.asarray(np.linalg.norm(self.error, axis=1))


def read_top_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the lines of ``associations.jsonl`` of top associations, and of members without any."""
    with path.open(encoding="utf-8") as file:
        for line in file:
            # Most lines are of other ranks, and reading them as JSON is what takes the time.
            if '"rank": 1,' in line or '"rank": 0,' in line:
                yield json.loads(line)


def curves_of(lines: Iterable[Mapping[str, Any]], members: Mapping[str, Mapping[str, Any]]) -> list[MemberCurves]:
    """Return the curves of every member that has a line, in the order of first appearance.

    Args:
        lines: as in ``associations.jsonl``, of rank 0 and 1.
        members: entries of the task definition by the member's name, which have units and names of rows.
    """
    grouped: dict[str, list[Mapping[str, Any]]] = {}
    for line in lines:
        name = "_".join([line["kernel"], *line["descriptor"].split("+")])
        grouped.setdefault(name, []).append(line)
    return [_curves(name, own, members.get(name, {})) for name, own in grouped.items()]


def _curves(name: str, lines: list[Mapping[str, Any]], entry: Mapping[str, Any]) -> MemberCurves:
    dim = max((len(line["error"]) for line in lines), default=0) or 1
    nothing = [math.nan] * dim
    # Meters are shown as millimeters, as in the overlay.
    unit = str(entry.get("unit", next((line["unit"] for line in lines if "unit" in line), "px")))
    unit, factor = ("mm", 1e3) if unit == "m" else (unit, 1.0)
    rows = [str(row).removeprefix(f"{name}.") for row in entry.get("error_rows", ())]
    return MemberCurves(
        name=name,
        unit=unit,
        rows=tuple(rows) if len(rows) == dim else tuple(str(row) for row in range(1, dim + 1)),
        frame=np.array([line["frame"] for line in lines], np.int64),
        time_s=np.array([line["time_s"] for line in lines], np.float64),
        error=factor * np.array([line["error"] or nothing for line in lines], np.float64).reshape(len(lines), dim),
        goal_norm=factor * np.array([_norm(line.get("goal_error")) for line in lines], np.float64),
        confidence=np.array([line["confidence"] for line in lines], np.float64),
        state=tuple(str(line.get("state", "")) for line in lines),
        is_certain=np.array([all(line.get("error_available") or [False]) for line in lines], np.bool_),
        switched=np.array([bool(line.get("switched")) for line in lines], np.bool_),
    )


def _norm(values: list[float] | None) -> float:
    return math.hypot(*values) if values else math.nan


def runs_of(values: tuple[str, ...]) -> Iterator[tuple[int, int, str]]:
    """Yield first and last place of each run of equal values, and the value.

    >>> list(runs_of(("a", "a", "b")))
    [(0, 1, 'a'), (2, 2, 'b')]
    """
    start = 0
    for place in range(1, len(values) + 1):
        if place == len(values) or values[place] != values[start]:
            yield start, place - 1, values[start]
            start = place
