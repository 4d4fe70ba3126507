"""From labeled pictures to regions: which frame a picture is, and which label the object, the target and the hand."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import final

import numpy as np

from geoskill.errors import InputError, shown
from geoskill.evaluation.annotations.picture import LabeledPicture, Shape
from geoskill.evaluation.regions import ROLES, FrameRegions, Polygon, Regions, size_text
from geoskill.simulation.roles import SceneRole

NOTHING = np.zeros((0, 2), np.float32)
MAX_NAMED = 10


@final
@dataclass(frozen=True)
class RoleNames:
    """What labels call the regions. Of whole numbers, only the value counts: ``001`` is 1.

    Attributes:
        object: the moved object.
        target: what it is brought to.
        hand: the agent; None for ``hand``, where there is such a label.
    """

    object: str = "object"
    target: str = "target"
    hand: str | None = None

    def by_label(self, labels: Iterable[str], path: str | Path) -> Mapping[str, str]:
        """Return the names of the roles by the label.

        Raises:
            InputError: when a label that is asked for does not occur, or is asked for twice.
        """
        there = {_plain(label) for label in labels}
        wanted = {"object": self.object, "target": self.target, "hand": self.hand or "hand"}
        roles: dict[str, str] = {}
        for role, label in wanted.items():
            if _plain(label) not in there:
                if role == "hand" and self.hand is None:
                    continue
                names = sorted(there)
                listed = ", ".join([*map(shown, names[:MAX_NAMED]), *(["…"] if len(names) > MAX_NAMED else [])])
                raise InputError(
                    f"{path}: nothing is labeled {label!r}; expected regions.{role}=LABEL, one of {listed or 'none'}"
                )
            if _plain(label) in roles:
                raise InputError(
                    f"{path}: regions.{role}={label} is regions.{roles[_plain(label)]}, too; expected another label"
                )
            roles[_plain(label)] = role
        return roles


def assigned_regions(
    path: str | Path,
    pictures: Iterable[LabeledPicture],
    names: RoleNames,
    frame_count: int | None,
    stems: Sequence[str] | None,
) -> Regions:
    """Return the regions of labeled pictures.

    Args:
        path: for messages.
        pictures: those that were labeled; a role without a shape on one of them is out of view there.
        names: the labels of the roles.
        frame_count: frames of the recording; None when it is not known.
        stems: names of the recording's pictures without their endings, where it has some. A labeled picture is the
            frame of that name; if none is, and of other recordings, the last number in its name is the frame's.

    Raises:
        InputError: when there is no picture, two are the same frame, one is no frame of the recording, their sizes
            differ, or a label does not occur.
    """
    labeled = list(pictures)
    if not labeled:
        raise InputError(f"{path}: nothing is labeled; expected at least one picture with shapes")
    for picture in labeled:
        if picture.size != labeled[0].size:
            raise InputError(
                f"{picture.origin}: {size_text(picture.size)}; expected {size_text(labeled[0].size)} like others"
            )
    roles = names.by_label((shape.label for picture in labeled for shape in picture.shapes), path)
    frames: dict[int, FrameRegions] = {}
    for number, picture in zip(_frame_numbers(labeled, frame_count, stems), labeled, strict=True):
        if number in frames:
            raise InputError(f"{picture.origin}: frame {number} is labeled twice; expected once")
        frames[number] = _frame_regions(picture.shapes, roles)
    return Regions(str(path), labeled[0].size, frames)


def _frame_numbers(
    pictures: Sequence[LabeledPicture], frame_count: int | None, stems: Sequence[str] | None
) -> list[int]:
    places = {stem: number for number, stem in enumerate(stems or ())}
    by_name = any(PurePath(picture.name).stem in places for picture in pictures)
    numbers = []
    for picture in pictures:
        stem = PurePath(picture.name).stem
        if picture.number is not None:
            number = picture.number
        elif by_name:
            if stem not in places:
                raise InputError(f"{picture.origin}: labels {shown(picture.name)}; expected a picture of the recording")
            number = places[stem]
        else:
            digits = re.findall(r"[0-9]{1,9}(?![0-9])", stem)
            if not digits:
                raise InputError(
                    f"{picture.origin}: labels {shown(picture.name)}; expected a picture of the recording, or a name"
                    " with the frame's number"
                )
            number = int(digits[-1])
        if frame_count is not None and number >= frame_count:
            raise InputError(
                f"{picture.origin}: frame {number} is beyond the video, which has {frame_count} frames; expected"
                f" numbers from 0 to {frame_count - 1}"
            )
        numbers.append(number)
    return numbers


def _frame_regions(shapes: Sequence[Shape], roles: Mapping[str, str]) -> FrameRegions:
    polygons: dict[SceneRole, Polygon] = dict.fromkeys(SceneRole, NOTHING)
    pieces: dict[SceneRole, Sequence[Polygon]] = {}
    holes: dict[SceneRole, Sequence[Polygon]] = {}
    for label, name in roles.items():
        own = [shape for shape in shapes if _plain(shape.label) == label]
        outlines = [outline for shape in own for outline in shape.outlines]
        if outlines:
            role = ROLES[name]
            polygons[role], *pieces[role] = outlines
            holes[role] = [hole for shape in own for hole in shape.holes]
    return FrameRegions(polygons, pieces, holes)


def _plain(label: str) -> str:
    return str(int(label)) if re.fullmatch(r"[0-9]{1,9}", label) else label
