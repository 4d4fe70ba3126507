"""Overlay of one frame and the associations that a skill selected in it, after the paper's Fig. 8.

On the image: every feature, and the selected associations as colored lines, the top one of each member red. Beside it:
a panel with a block for each member: the control error of its top association and, in the colors of the lines, the
confidence of each association shown.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node
from geoskill.viz.drawing import Color, Scale, draw_disc, draw_polyline, draw_text, rank_color, text_size
from geoskill.viz.panel import PAPER, Block, draw_panel

_FEATURE: Color = (255, 235, 120)
_FEATURE_CASING: Color = (45, 45, 50)
_CASING: Color = (15, 15, 20)


def draw_overlay(
    image: UInt8[np.ndarray, "height width 3"],
    features: Sequence[FeatureSet],
    associations: Sequence[Association],
    *,
    frame_index: int,
    title: str = "",
    minimum_weight: float = 0.1,
    reasons: Sequence[str] = (),
    states: Mapping[str, str] | None = None,
) -> UInt8[np.ndarray, "out_height out_width 3"]:
    """Draw features and associations on a frame, with the panel to its right; RGB.

    The image is enlarged by the smallest integer that makes its shorter side at least 480 pixels long, so that pixel x
    of the frame becomes ``factor * (x + 0.5) - 0.5``. The size of the result depends on that of the frame alone, so
    that all frames of a video have the same size. Of each member the top association is drawn, and the others with a
    select-out above ``minimum_weight`` (10 % in the paper). With several members, the lines carry the letter of their
    block and their rank. Line features of an association are drawn thick and joined at their midpoints; more than two
    nodes are joined in a ring.

    Args:
        image: RGB; not modified.
        features: features of every extractor, in pixels of ``image``.
        associations: associations of all members, in any order. One without nodes (rank 0) shows that its member has no
            instance.
        frame_index: number to print.
        title: one line, truncated where it is too long.
        minimum_weight: in [0, 1].
        reasons: why members have no instance, one sentence for each.
        states: of the members by name, shown beside their names; None for none.
    """
    scale = Scale.of(image)
    members = _members(associations, minimum_weight, states or {})
    enlarged = cv2.resize(image, None, fx=scale.factor, fy=scale.factor, interpolation=cv2.INTER_CUBIC)
    canvas = np.ascontiguousarray(enlarged, np.uint8)
    for feature_set in features:
        for geometry in feature_set.geometry:
            _draw_feature(canvas, scale, feature_set.node_type, geometry.reshape(-1, 2))
    shown = [(member.letter, association) for member in members for association in member.shown]
    # The best ones last, so that nothing covers them.
    shown.sort(key=lambda pair: -pair[1].rank)
    for _, association in shown:
        _draw_association(canvas, scale, association)
    if len(members) > 1:
        for letter, association in shown:
            _draw_tag(canvas, scale, association, f"{letter}{association.rank}")
    blocks = [
        Block(f"{member.letter}  {member.heading}" if len(members) > 1 else member.heading, member.shown)
        for member in members
    ]
    panel = draw_panel(len(canvas), scale, blocks, f"frame {frame_index}", title, reasons)
    return np.concatenate([canvas, panel], axis=1)


@final
class _Member(NamedTuple):
    letter: str
    heading: str
    shown: list[Association]


def _members(associations: Iterable[Association], minimum_weight: float, states: Mapping[str, str]) -> list[_Member]:
    """Group the associations by member, in the order of first appearance, and keep those to show, by rank."""
    grouped: dict[str, list[Association]] = {}
    for association in associations:
        grouped.setdefault(association.member, []).append(association)
    members = []
    for i, (name, group) in enumerate(grouped.items()):
        group.sort(key=lambda association: association.rank)
        with_nodes = [association for association in group if association.nodes]
        shown = with_nodes[:1] + [association for association in with_nodes[1:] if association.weight > minimum_weight]
        heading = " ".join([group[0].kernel, group[0].descriptor, *([states[name]] if name in states else [])])
        members.append(_Member(chr(ord("A") + i), heading, shown))
    return members


def _draw_feature(
    canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, node_type: NodeType, xy: Float[np.ndarray, "p 2"]
) -> None:
    # The dark casing keeps a pale mark legible on a pale background.
    for color, width in ((_FEATURE_CASING, 2 * scale.px(1)), (_FEATURE, scale.px(1))):
        if node_type is NodeType.POINT:
            draw_disc(canvas, scale.enlarged(xy)[0], 2.6 * scale.unit, color, width)
        else:
            draw_polyline(canvas, scale.enlarged(xy), color, width)


def _draw_association(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, association: Association) -> None:
    color = rank_color(association.rank)
    width = scale.px(3 if association.rank == 1 else 2)
    casing = width + 2 * scale.px(1)
    centers = scale.enlarged(np.array([node.center for node in association.nodes]))
    closed = len(centers) > 2
    if closed:
        # Around their centroid, so that the ring does not cross itself.
        offset = centers - centers.mean(axis=0)
        centers = centers[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]), kind="stable")]
    for pen, link_width, node_width in ((_CASING, casing, casing + scale.px(1)), (color, width, width + scale.px(1))):
        draw_polyline(canvas, centers, pen, link_width, closed)
        for node in association.nodes:
            _draw_node(canvas, scale, node, pen, node_width)


def _draw_node(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, node: Node, pen: Color, width: int) -> None:
    xy = scale.enlarged(np.reshape(np.asarray(node.coordinates, np.float64), (-1, 2)))
    if node.node_type is NodeType.POINT:
        draw_disc(canvas, xy[0], width / 2 + 2.5 * scale.unit, pen)
    else:
        draw_polyline(canvas, xy, pen, width)
        draw_disc(canvas, xy.mean(axis=0), width / 2 + 0.5 * scale.unit, pen)


def _draw_tag(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, association: Association, tag: str) -> None:
    size = 0.4 * scale.unit
    width, height = text_size(tag, size)
    center = scale.enlarged(np.array([node.center for node in association.nodes])).mean(axis=0)
    padding = scale.px(3)
    left = int(np.clip(round(center[0] - width / 2), padding, max(padding, canvas.shape[1] - width - padding)))
    top = int(np.clip(round(center[1] - height / 2), padding, max(padding, canvas.shape[0] - height - padding)))
    corners = (left - padding, top - padding), (left + width + padding, top + height + padding)
    cv2.rectangle(canvas, *corners, rank_color(association.rank), -1)
    cv2.rectangle(canvas, *corners, _CASING, scale.px(1))
    draw_text(canvas, tag, (left, top + height), size, PAPER)
