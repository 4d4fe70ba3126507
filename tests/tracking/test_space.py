"""Places in space of tracked features: by hand, on a scene of two depths."""

import numpy as np
import torch

from geoskill.features.feature_set import FeatureSet
from geoskill.features.lifting import lift
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.motion import Displacement, Trajectory
from geoskill.tracking.space import end_frames, lift_motions

CAMERA = DepthCamera(100.0, 100.0, 20.0, 15.0)


def at_depth(depth_m: float) -> DepthPicture:
    return DepthPicture(np.full((31, 41), depth_m, np.float32), CAMERA)


def test_features_are_lifted_with_the_depth_of_the_frame_that_they_lead_to() -> None:
    """Three features: tracked, lost, and at rest at its very pixel while something passes before it."""
    depths = [at_depth(1.0), at_depth(0.5)]
    pixels = np.array([[20.0, 15.0], [10.0, 15.0], [30.0, 15.0]], np.float32)
    space, covariance = lift(NodeType.POINT, pixels, depths[0])
    descriptors, scores = np.ones((3, 1), np.float32), np.ones(3, np.float32)
    now = FeatureSet(NodeType.POINT, descriptors, pixels, scores, space=space, space_covariance=covariance)
    later = FeatureSet.empty(NodeType.POINT, 1)
    later = FeatureSet(
        NodeType.POINT,
        later.descriptors,
        later.geometry,
        later.scores,
        space=space[:0],
        space_covariance=covariance[:0],
    )
    moved = torch.from_numpy(pixels) + torch.tensor([[5.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    tracked = torch.tensor([True, False, True])
    trajectory = Trajectory(moved[:, None], torch.tensor([0, 1, 0]), moved, tracked, torch.zeros(3, dtype=torch.long))
    nothing = Trajectory(
        *(rows[:0] for rows in (moved[:, None], torch.zeros(3).long(), moved, tracked)), torch.zeros(0).long()
    )
    displacements, trajectories = lift_motions(
        [now, later],
        {(0, 1): Displacement(moved, tracked)},
        [trajectory, nothing],
        *end_frames(2, anchors=1),
        depths,
    )
    expected = np.array([[0.025, 0, 0.5], [-0.1, 0, 1.0], [0.1, 0, 1.0]])
    np.testing.assert_allclose(displacements[0, 1].next_space, expected, atol=1e-6)
    np.testing.assert_allclose(trajectories[0].final_space, expected, atol=1e-6)
    # The anchor is in the first frame.
    expected[0] = [0.05, 0, 1.0]
    np.testing.assert_allclose(trajectories[0].anchor_space[:, 0], expected, atol=1e-6)
