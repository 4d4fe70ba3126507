"""Marks of features and associations on a picture.

What moves is solid and what rests is hollow, points as well as lines; the dashes between them say only that they belong
together, and their arrow points at what rests. A cross shows where a moving node belongs.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node, NodeRole
from geoskill.viz.drawing import (
    CASING,
    INK,
    PAPER,
    Color,
    Scale,
    draw_dashes,
    draw_disc,
    draw_polyline,
    draw_text,
    rank_color,
    text_size,
)

_FEATURE: Color = (255, 235, 120)
_FEATURE_CASING: Color = (45, 45, 50)
DASH_PX = 6
"""Length of a dash of a connector, for a shorter side of 480 pixels."""
_CROSS_PX = 5


def draw_feature(
    canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, node_type: NodeType, xy: Float[np.ndarray, "p 2"]
) -> None:
    """Draw a feature that was detected, ``xy`` in pixels of the frame."""
    # The dark casing keeps a pale mark legible on a pale background.
    for color, width in ((_FEATURE_CASING, 2 * scale.px(1)), (_FEATURE, scale.px(1))):
        if node_type is NodeType.POINT:
            draw_disc(canvas, scale.enlarged(xy)[0], 2.6 * scale.unit, color, width)
        else:
            shown = scale.enlarged(outline(node_type, xy))
            draw_polyline(canvas, shown, color, width, closed=node_type is not NodeType.LINE)


def outline(node_type: NodeType, xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "q 2"]:
    """Return the points to draw of a segment, of the outline of a plane, or of an ellipse given by two diameters."""
    if node_type is not NodeType.CONIC:
        return xy
    angle = np.linspace(0.0, 2 * np.pi, 48, endpoint=False)[:, None]
    around = np.cos(angle) * (xy[0] - xy[1]) / 2 + np.sin(angle) * (xy[2] - xy[3]) / 2
    return np.asarray(xy.mean(axis=0) + around)


def draw_association(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, association: Association) -> None:
    """Draw the nodes of an association, and dashes between them; more than two nodes are joined in a ring."""
    color = rank_color(association.rank)
    width = scale.px(3 if association.rank == 1 else 2)
    centers = scale.enlarged(np.array([node.center for node in association.nodes]))
    if len(centers) > 2:
        # Around their centroid, so that the ring does not cross itself.
        offset = centers - centers.mean(axis=0)
        centers = centers[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]), kind="stable")]
    for pen, pen_width in ((CASING, width + 2 * scale.px(1)), (color, width)):
        draw_dashes(canvas, centers, pen, pen_width, scale.px(DASH_PX), closed=len(centers) > 2)
    if len(association.nodes) == 2:
        _draw_arrow(canvas, scale, association.nodes, color)
    if association.goal is not None and association.rank == 1:
        for place in association.goal.nodes:
            if place is not None:
                draw_cross(canvas, scale, scale.enlarged(np.reshape(place, (-1, 2))).mean(axis=0), color)
    for node in association.nodes:
        draw_node(canvas, scale, node, color, scale.px(3 if association.rank == 1 else 2))


def draw_node(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, node: Node, color: Color, width: int) -> None:
    """Draw a node: solid if it moves, hollow if it rests, with a dark core if that is not known.

    Args:
        canvas: the enlarged picture.
        scale: of the overlay.
        node: in pixels of the frame.
        color: of its association.
        width: of a line, in pixels of the overlay.
    """
    xy = scale.enlarged(np.reshape(np.asarray(node.coordinates, np.float64), (-1, 2)))
    core = {NodeRole.MOVING: color, NodeRole.RESTING: PAPER}.get(node.role, INK) if node.role else INK
    edge = scale.px(1)
    if node.node_type is NodeType.POINT:
        radius = width / 2 + 3.5 * scale.unit
        for pen, reach in ((CASING, edge), (color, 0), (core, -1.6 * edge)):
            draw_disc(canvas, xy[0], radius + reach, pen)
    else:
        outer, closed = width + 2 * edge, node.node_type is not NodeType.LINE
        xy = outline(node.node_type, xy)
        for pen, thickness in ((CASING, outer + 2 * edge), (color, outer), (core, max(1, outer - 3 * edge))):
            draw_polyline(canvas, xy, pen, thickness, closed)


def draw_cross(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, center: Float[np.ndarray, " 2"], color: Color) -> None:
    """Draw where a moving node belongs, ``center`` in pixels of the overlay."""
    reach = scale.px(_CROSS_PX)
    for pen, width in ((CASING, 4 * scale.px(1)), (color, 2 * scale.px(1))):
        for arm in (np.array([reach, reach]), np.array([reach, -reach])):
            draw_polyline(canvas, np.stack([center - arm, center + arm]), pen, width)


def draw_tag(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, association: Association, tag: str) -> None:
    """Write the name of an association into the middle of it."""
    size = 0.4 * scale.text
    width, height = text_size(tag, size)
    center = scale.enlarged(np.array([node.center for node in association.nodes])).mean(axis=0)
    padding = scale.px(3)
    left = int(np.clip(round(center[0] - width / 2), padding, max(padding, canvas.shape[1] - width - padding)))
    top = int(np.clip(round(center[1] - height / 2), padding, max(padding, canvas.shape[0] - height - padding)))
    corners = (left - padding, top - padding), (left + width + padding, top + height + padding)
    cv2.rectangle(canvas, *corners, rank_color(association.rank), -1)
    cv2.rectangle(canvas, *corners, CASING, scale.px(1))
    draw_text(canvas, tag, (left, top + height), size, PAPER)


def _draw_arrow(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, nodes: Sequence[Node], color: Color) -> None:
    """Draw the head of an arrow from what moves to what rests, two thirds of the way; none where that is not known."""
    centers = {node.role: scale.enlarged(np.array([node.center]))[0] for node in nodes}
    if set(centers) != {NodeRole.MOVING, NodeRole.RESTING}:
        return
    way = centers[NodeRole.RESTING] - centers[NodeRole.MOVING]
    length, size = float(np.linalg.norm(way)), scale.px(9)
    if length < 3 * size:
        return
    along = way / length
    across = np.array([-along[1], along[0]])
    tip = centers[NodeRole.MOVING] + way * 2 / 3
    corners = np.stack([tip, tip - size * along + 0.5 * size * across, tip - size * along - 0.5 * size * across])
    for pen, width in ((CASING, 2 * scale.px(1)), (color, 1)):
        draw_polyline(canvas, corners, pen, width, closed=True)
        if pen is color:
            cv2.fillPoly(canvas, [np.round(corners * 16).astype(np.int32)], color, cv2.LINE_AA, 4)
