"""Tests of the oracle on the hand-made recording, whose fixture describes the scene."""

from dataclasses import replace

import numpy as np
import pytest

from geoskill.evaluation.oracle import evaluate_oracle
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.par import Parallel
from geoskill.simulation.recording import Recording

# A point of the box on the first frame; at the goal it is above column 30, where the tile has a point too.
ON_BOX = (14.0, 15.0)
MEETS_IT, THREE_AWAY, TABLE = (30.0, 13.0), (33.0, 13.0), (20.0, 25.0)


def points(*places: tuple[float, float]) -> dict[NodeType, FeatureSet]:
    geometry = np.array(places, np.float32).reshape(-1, 2)
    ones = np.ones((len(places), 1), np.float32)
    return {NodeType.POINT: FeatureSet(NodeType.POINT, ones, geometry, ones[:, 0])}


def moved(recording: Recording, meters: float) -> Recording:
    """Return the recording with the camera moved to the right."""
    camera = recording.camera_poses.copy()
    camera[:, 0, 3] += meters
    return replace(recording, camera_poses=camera)


def test_oracle_from_same_viewpoint_is_perfect(hand_made_recording: Recording) -> None:
    features = {0: points(ON_BOX, MEETS_IT, THREE_AWAY, TABLE), 1: points(MEETS_IT)}
    metrics = evaluate_oracle(PointToPoint(), hand_made_recording, features, hand_made_recording)
    assert metrics["oracle_strict_accuracy"] == 1
    assert metrics["oracle_goal_error_mm"] == pytest.approx(0, abs=1e-3)


def test_oracle_error_from_other_viewpoint(hand_made_recording: Recording) -> None:
    """The tile moves by 80 px per meter, the box's top, 0.8 m from the camera, by 100; a pixel there is 1 cm."""
    features = {0: points(ON_BOX, MEETS_IT), 1: points(ON_BOX, MEETS_IT, THREE_AWAY)}
    for meters, error_mm in ((0.1, 20.0), (-0.05, 10.0), (0.01, 2.0)):
        metrics = evaluate_oracle(PointToPoint(), hand_made_recording, features, moved(hand_made_recording, meters))
        assert metrics["oracle_goal_error_mm"] == pytest.approx(error_mm, abs=1e-3)
        assert metrics["oracle_strict_accuracy"] == (error_mm <= 3)


def test_oracle_error_is_median_of_all_frames(hand_made_recording: Recording) -> None:
    """The box a quarter turn farther, at the goal seen from the same place: its points move."""
    poses = hand_made_recording.poses.copy()
    box = list(hand_made_recording.bodies).index("box")
    poses[1, box, :3, :3] = poses[1, box, :3, :3] @ np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = replace(hand_made_recording, poses=poses)
    features = {0: points(ON_BOX, MEETS_IT), 1: points()}
    metrics = evaluate_oracle(PointToPoint(), hand_made_recording, features, turned)
    assert metrics["oracle_goal_error_mm"] == pytest.approx(10 * 8**0.5, abs=1e-3)  # from (0, 2) to (-2, 0) px
    assert metrics["oracle_strict_accuracy"] == 0


def test_oracle_without_meeting_instances(hand_made_recording: Recording) -> None:
    nothing = {"oracle_strict_accuracy": None, "oracle_goal_error_mm": None}
    features = {0: points(ON_BOX, THREE_AWAY), 1: points(TABLE)}
    assert evaluate_oracle(PointToPoint(), hand_made_recording, features, hand_made_recording) == nothing
    assert evaluate_oracle(PointToPoint(), hand_made_recording, {}, hand_made_recording) == nothing


def test_oracle_of_angle_error_is_none(hand_made_recording: Recording) -> None:
    nothing = {"oracle_strict_accuracy": None, "oracle_goal_error_mm": None}
    assert (
        evaluate_oracle(Parallel(), hand_made_recording, {0: points(ON_BOX, MEETS_IT)}, hand_made_recording) == nothing
    )
