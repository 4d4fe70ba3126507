"""Tests of strict evaluation at the goal on the hand-made recording, whose fixture describes the scene."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from geoskill.evaluation.goal import evaluate_at_goal
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels
from geoskill.evaluation.regions import FrameRegions
from geoskill.evaluation.simulated import SimulatedFrame
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.p2p3 import PointToPointInSpace
from geoskill.kernels.p2pl import PointToPlane
from geoskill.kernels.par import Parallel
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import Node

XY = tuple[float, ...]

# On the first frame. At the goal the box's right edge is its far one, at (30, 13), where the tile has a point, too.
ON_BOX, BESIDE_IT, MEETS_IT, THREE_AWAY = (14.0, 15.0), (14.0, 16.0), (30.0, 13.0), (33.0, 13.0)
TABLE, FINGER = (20.0, 25.0), (12.0, 9.0)
# The middle row of the box, which comes to lie on column 30 of the tile; and the tile's right column.
ROW, COLUMN, RIGHT = (10.0, 15.0, 14.0, 15.0), (30.0, 12.0, 30.0, 18.0), (33.0, 12.0, 33.0, 18.0)


def nodes(*places: XY) -> tuple[Node, ...]:
    return tuple(Node(NodeType.POINT if len(place) == 2 else NodeType.LINE, place) for place in places)


def features(*places: XY) -> dict[NodeType, FeatureSet]:
    feature_sets = {}
    for kind in NodeType:
        rows = [place for place in places if len(place) == kind.geometry_dim]
        geometry = np.array(rows, np.float32).reshape(-1, kind.geometry_dim)
        feature_sets[kind] = FeatureSet(
            kind, np.ones((len(rows), 1), np.float32), geometry, np.ones(len(rows), np.float32)
        )
    return feature_sets


@pytest.fixture(scope="module")
def labels(hand_made_recording: Recording) -> SimulatedFrame:
    return SimulatedFrame(hand_made_recording, 0)


@pytest.mark.parametrize(
    ("top", "others", "error_m", "feasible"),
    [
        ((ON_BOX, MEETS_IT), (), 0.0, True),
        ((MEETS_IT, ON_BOX), (), 0.0, True),
        ((ON_BOX, THREE_AWAY), (), 0.03, False),  # 3 px of 1 cm
        ((ON_BOX, THREE_AWAY), (MEETS_IT,), 0.03, True),
        ((ON_BOX, TABLE), (MEETS_IT,), None, True),
        ((FINGER, ON_BOX), (THREE_AWAY,), None, False),
        # Within one thing nothing joins, even where it meets; its error is as far as its points are apart, for good.
        ((ON_BOX, BESIDE_IT), (), 0.01, False),
        ((MEETS_IT, MEETS_IT), (), 0.0, False),
        ((), (ON_BOX, MEETS_IT), None, True),
        ((), (), None, False),
    ],
)
def test_evaluate_at_goal_points(
    labels: SimulatedFrame, top: Sequence[XY], others: Sequence[XY], error_m: float | None, feasible: bool
) -> None:
    result = evaluate_at_goal(PointToPoint(), nodes(*top), features(*top, *others), labels)
    assert result is not None
    assert result.feasible is feasible
    assert result.error_m == (None if error_m is None else pytest.approx(error_m, abs=1e-6))


@pytest.mark.parametrize(
    ("kernel", "top", "error_m", "feasible"),
    [
        (LineToLine(), (ROW, COLUMN), 0.0, True),
        # Both of the error's numbers are the distance of the parallel lines.
        (LineToLine(), (ROW, RIGHT), 0.03 * 2**0.5, False),
        (LineToLine(), (ROW, (*TABLE, 28.0, 25.0)), None, False),
        (LineToLine(), (ROW, (30.0, 14.0, 30.0, 25.0)), None, False),  # one end is off the tile
        (PointToLine(), (MEETS_IT, ROW), 0.0, True),
        (PointToLine(), (THREE_AWAY, ROW), 0.03, False),
        (PointToLine(), (ON_BOX, RIGHT), 0.03, False),
    ],
)
def test_evaluate_at_goal_lines(
    labels: SimulatedFrame, kernel: Kernel, top: Sequence[XY], error_m: float | None, feasible: bool
) -> None:
    result = evaluate_at_goal(kernel, nodes(*top), features(*top), labels)
    assert result is not None
    assert result.feasible is feasible
    assert result.error_m == (None if error_m is None else pytest.approx(error_m, abs=1e-6))


# The point of the box is at (0.1, 0.02, 0.2) at the goal, that of the tile at (0.125, 0.025, 0).
APART_M = (0.025**2 + 0.005**2 + 0.2**2) ** 0.5
# Seen from 1 m above: corners around the box and the tile, and their planes as measured in the camera's frame.
TOP, ON_TILE = (10.0, 13.0, 14.0, 13.0, 14.0, 17.0, 10.0, 17.0), (27.0, 12.0, 33.0, 12.0, 33.0, 18.0, 27.0, 18.0)
TOP_PLANE, TILE_PLANE = (0.0, 0.0, -1.0, 0.801), (0.0, 0.0, -1.0, 0.998)


@pytest.mark.parametrize(
    ("kernel", "top", "error_m"),
    [
        # They meet in the picture alone.
        (PointToPoint(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.POINT, MEETS_IT)), 0.0),
        (PointToPointInSpace(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.POINT, MEETS_IT)), APART_M),
        (PointToPointInSpace(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.POINT, TABLE)), None),
        # What the plane is measured to be says which one it is, not where.
        (PointToPlane(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.PLANE, ON_TILE, space=TILE_PLANE)), 0.2),
        (PointToPlane(), (Node(NodeType.POINT, MEETS_IT), Node(NodeType.PLANE, TOP, space=TOP_PLANE)), 0.2),
        (PointToPlane(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.PLANE, TOP, space=TILE_PLANE)), None),
        (PointToPlane(), (Node(NodeType.POINT, ON_BOX), Node(NodeType.PLANE, ON_TILE)), None),
    ],
)
def test_evaluate_at_goal_in_space(
    labels: SimulatedFrame, kernel: Kernel, top: tuple[Node, ...], error_m: float | None
) -> None:
    sets = {}
    for kind in NodeType:
        own = [node for node in top if node.node_type is kind]
        geometry = np.array([node.coordinates for node in own], np.float32).reshape(-1, kind.geometry_dim)
        space = np.zeros((len(own), kind.space_dim), np.float32)
        for row, node in zip(space, own, strict=True):
            row[:] = node.space or (0.0,) * kind.space_dim
        ones = np.ones((len(own), 1), np.float32)
        covariance = np.zeros((len(own), kind.space_dim, kind.space_dim), np.float32)
        sets[kind] = FeatureSet(kind, ones, geometry, ones[:, 0], space=space, space_covariance=covariance)
    result = evaluate_at_goal(kernel, top, {kind: sets[kind] for kind in kernel.roles}, labels)
    assert result is not None
    assert result.error_m == (None if error_m is None else pytest.approx(error_m, abs=1e-6))
    assert result.feasible is (error_m == 0.0)


def test_evaluate_at_goal_in_space_of_what_stays_apart(labels: SimulatedFrame) -> None:
    top, own = nodes(ON_BOX, MEETS_IT), features(ON_BOX, MEETS_IT)
    # From the tile to the box, in the camera's frame: 2.5 cm to the left, 5 mm down in the picture, 20 cm nearer.
    apart = [-0.025, 0.005, -0.2]
    kernel = PointToPointInSpace()
    points = {NodeType.POINT: replace(own[NodeType.POINT], **lifted_nowhere(2))}
    right = evaluate_at_goal(kernel, top, points, labels, apart)
    assert right is not None
    assert (right.error_m, right.feasible) == (pytest.approx(0, abs=1e-6), True)
    wrong = evaluate_at_goal(kernel, top, points, labels, [-0.025, 0.005, -0.196])
    assert wrong is not None
    assert (wrong.error_m, wrong.feasible) == (pytest.approx(0.004, abs=1e-6), True)
    # A kernel of the picture does not take it.
    meets = evaluate_at_goal(PointToPoint(), top, own, labels, [5.0, 5.0])
    assert meets is not None
    assert meets.error_m == pytest.approx(0, abs=1e-6)


def lifted_nowhere(count: int) -> dict[str, np.ndarray]:
    return {"space": np.zeros((count, 3), np.float32), "space_covariance": np.zeros((count, 3, 3), np.float32)}


def test_plane_is_labeled_by_what_it_shows_and_an_ellipse_by_its_outline(labels: SimulatedFrame) -> None:
    assert labels.feature_label(NodeType.PLANE, TOP) is SceneRole.OBJECT
    assert labels.feature_label(NodeType.PLANE, ON_TILE) is SceneRole.TARGET
    assert labels.feature_label(NodeType.PLANE, TOP, among=(SceneRole.TARGET,)) is None
    # One that box and tile share is on neither, and so is the table, wherever its center is.
    assert labels.feature_label(NodeType.PLANE, (8.0, 12.0, 34.0, 12.0, 34.0, 18.0, 8.0, 18.0)) is None
    assert labels.feature_label(NodeType.PLANE, (0.0, 0.0, 39.0, 0.0, 39.0, 29.0, 0.0, 29.0)) is None
    # Around the finger there is not enough of anything.
    assert labels.feature_label(NodeType.CONIC, (13.0, 10.0, 11.0, 10.0, 12.0, 11.0, 12.0, 9.0)) is None


def test_evaluate_at_goal_without_length_or_goal(labels: SimulatedFrame) -> None:
    assert evaluate_at_goal(Parallel(), nodes(ROW, COLUMN), features(ROW, COLUMN), labels) is None
    outlines = FrameRegions({region: np.zeros((0, 2), np.float32) for region in SceneRole})
    top = (ON_BOX, MEETS_IT)
    assert evaluate_at_goal(PointToPoint(), nodes(*top), features(*top), outlines) is None


class Pair(FrameLabels):
    """Labels with the object left of column 50, the target on the rest, and the goal 100 px to the right of the object.

    A pixel is a millimeter wide.
    """

    def label(
        self,
        point: tuple[float, float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        return SceneRole.OBJECT if point[0] < 50 else SceneRole.TARGET

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> list[tuple[float, float] | None] | None:
        return [(x + 100 if x < 50 else x, y) for x, y in coordinates]

    def feature_label(
        self,
        node_type: NodeType,
        coordinates: Sequence[float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        return self.label((coordinates[0], coordinates[1]), tolerance_px, among)

    def feature_at_goal(
        self, node_type: NodeType, coordinates: Sequence[float], space: Sequence[float] | None, in_space: bool
    ) -> tuple[float, ...] | None:
        return None

    @property
    def goal_pixel_m(self) -> float | None:
        return 0.001


@pytest.mark.parametrize(("apart_px", "feasible"), [(0.0, True), (2.99, True), (3.01, False)])
def test_evaluate_at_goal_feasible_within_three_millimeters(apart_px: float, feasible: bool) -> None:
    top = ((10.0, 20.0), (110.0, 20.0 + apart_px))
    result = evaluate_at_goal(PointToPoint(), nodes(*top), features(*top), Pair())
    assert result is not None
    assert result.error_m == pytest.approx(apart_px / 1000)
    assert result.feasible is feasible
