"""Overlay of one frame and the associations that a skill selected in it, after the paper's Fig. 8.

::

    +-----------------------+-------+    picture: every feature, and the selected associations (geoskill.viz.marks),
    | picture               | panel |             the top one of each member red
    |                       |       |    panel:   state, control error and confidences of each member
    +-----------------------+       |    strip:   legend, and the errors over the frames so far
    | strip                 |       |
    +-----------------------+-------+
"""

from dataclasses import replace
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.skill.association import Association, InferenceResult
from geoskill.skill.member_status import State
from geoskill.viz.drawing import Scale, panel_width
from geoskill.viz.marks import draw_association, draw_feature, draw_tag
from geoskill.viz.panel import Block, draw_panel
from geoskill.viz.strip import ErrorHistory, draw_strip, member_color


def draw_overlay(
    image: UInt8[np.ndarray, "height width 3"],
    result: InferenceResult,
    *,
    frame_index: int,
    time_s: float | None = None,
    title: str = "",
    minimum_weight: float = 0.1,
    history: ErrorHistory | None = None,
) -> UInt8[np.ndarray, "out_height out_width 3"]:
    """Draw features and associations on a frame, with the panel to its right and the strip below it; RGB.

    The picture is enlarged by the smallest integer that makes its shorter side at least 480 pixels long, so that pixel
    x of the frame becomes ``factor * (x + 0.5) - 0.5``. The size of the result depends on that of the frame alone, so
    that all frames of a video have the same size. Of each member the top association is drawn, and the others with a
    select-out above ``minimum_weight`` (10 % in the paper). With several members, associations carry the letter of
    their block and their rank.

    Args:
        image: RGB; not modified.
        result: what was selected in the frame.
        frame_index: number to print.
        time_s: seconds after the first frame, to print; None for none.
        title: one line, truncated where it is too long.
        minimum_weight: in [0, 1].
        history: of the errors up to this frame, this one included; None for none.
    """
    scale = Scale.of(image)
    members = _members(result, minimum_weight)
    picture = _draw_picture(image, result, members, scale)
    blocks = [
        Block(
            f"{member.letter} {member.heading}" if len(members) > 1 else member.heading,
            member.shown,
            member.state,
            None if history is None else member_color(number),
        )
        for number, member in enumerate(members)
    ]
    left = np.concatenate([picture, draw_strip(picture.shape[1], scale, history)])
    place = f"frame {frame_index}" if time_s is None else f"#{frame_index}  {time_s:.2f} s"
    reasons = [f"{name}: {reason}" for name, reason in result.reasons.items()]
    width = panel_width(picture.shape[1])
    return np.concatenate([left, draw_panel(len(left), width, scale, blocks, place, title, reasons)], axis=1)


def draw_associations(
    image: UInt8[np.ndarray, "height width 3"], result: InferenceResult
) -> UInt8[np.ndarray, "out_height out_width 3"]:
    """Draw the top association of each member on a frame, enlarged as in an overlay, and nothing else; RGB.

    Args:
        image: RGB; not modified.
        result: what was selected in the frame.
    """
    top = replace(result, features={}, associations=tuple(own for own in result.associations if own.rank == 1))
    return _draw_picture(image, top, _members(top, 1.0), Scale.of(image))


@final
class _Member(NamedTuple):
    letter: str
    heading: str
    shown: list[Association]
    state: State | None


def _members(result: InferenceResult, minimum_weight: float) -> list[_Member]:
    """Return the members in their order, each with the associations to show, by rank."""
    grouped: dict[str, list[Association]] = {name: [] for name in result.members}
    for association in result.associations:
        grouped.setdefault(association.member, []).append(association)
    members = []
    for i, (name, group) in enumerate(grouped.items()):
        group.sort(key=lambda association: association.rank)
        shown = group[:1] + [association for association in group[1:] if association.weight > minimum_weight]
        heading = f"{group[0].kernel} {group[0].descriptor}" if group else name.replace("_", " ", 1)
        members.append(_Member(chr(ord("A") + i), heading, shown, result.states.get(name)))
    return members


def _draw_picture(
    image: UInt8[np.ndarray, "height width 3"], result: InferenceResult, members: list[_Member], scale: Scale
) -> UInt8[np.ndarray, "h w 3"]:
    enlarged = cv2.resize(image, None, fx=scale.factor, fy=scale.factor, interpolation=cv2.INTER_CUBIC)
    canvas = np.ascontiguousarray(enlarged, np.uint8)
    for feature_set in result.features.values():
        for geometry in feature_set.geometry:
            draw_feature(canvas, scale, feature_set.node_type, geometry.reshape(-1, 2))
    shown = [(member.letter, association) for member in members for association in member.shown]
    # The best ones last, so that nothing covers them.
    shown.sort(key=lambda pair: -pair[1].rank)
    for _, association in shown:
        draw_association(canvas, scale, association)
    if len(members) > 1:
        for letter, association in shown:
            draw_tag(canvas, scale, association, f"{letter}{association.rank}")
    return canvas
