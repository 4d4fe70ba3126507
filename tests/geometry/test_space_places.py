"""Features in space: moved, compared and followed."""

import numpy as np
from scipy.spatial.transform import Rotation

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space_places import distances_in_space, laid_over, moved_place, shift_between

POINT, LINE, PLANE = NodeType.POINT, NodeType.LINE, NodeType.PLANE
MOTION = np.eye(4)
MOTION[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
MOTION[:3, 3] = [0.1, -0.05, 0.2]


def test_points_of_a_plane_and_of_a_line_stay_on_it() -> None:
    random = np.random.default_rng(0)
    normal = np.array([0.6, 0.0, -0.8])
    plane = np.append(normal, 0.5)
    across = np.linalg.svd(normal[None])[2][1:]
    points = -0.5 * normal + random.uniform(-1, 1, (6, 2)) @ across
    later = np.array([moved_place(POINT, point, MOTION) for point in points])
    np.testing.assert_allclose(later, points @ MOTION[:3, :3].T + MOTION[:3, 3], atol=1e-12)
    now = moved_place(PLANE, plane, MOTION)
    np.testing.assert_allclose(later @ now[:3] + now[3], 0, atol=1e-12)
    line = moved_place(LINE, np.concatenate([points[0], points[1]]), MOTION)
    np.testing.assert_allclose(line, np.concatenate([later[0], later[1]]), atol=1e-12)


def test_distances() -> None:
    points = np.array([[0.0, 0.0, 1.0], [3.0, 4.0, 1.0]])
    np.testing.assert_allclose(distances_in_space(POINT, points, points[0]), [0.0, 5.0])
    carrier = np.array([0.0, 0.0, 1.0, 2.0, 0.0, 1.0])
    beyond, turned = np.array([5.0, 3.0, 5.0, 9.0, 3.0, 5.0]), np.array([0.0, 0.0, 1.0, 0.0, 1.0, 1.0])
    np.testing.assert_allclose(distances_in_space(LINE, np.stack([carrier, carrier[[3, 4, 5, 0, 1, 2]]]), beyond), 5.0)
    np.testing.assert_allclose(distances_in_space(LINE, turned[None], carrier), [2.0])


def test_shift_of_lines_and_planes_is_across_them() -> None:
    np.testing.assert_allclose(shift_between(POINT, np.zeros(3), np.array([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0])
    before, after = np.array([0.0, 0, 1, 1, 0, 1]), np.array([0.7, 0.2, 1, 1.7, 0.2, 1])
    np.testing.assert_allclose(shift_between(LINE, before, after), [0.0, 0.2, 0.0], atol=1e-12)
    plane = np.array([0.0, 0.0, -1.0, 0.7])
    shift = shift_between(PLANE, plane, np.array([0.0, 0.0, -1.0, 0.8]))
    np.testing.assert_allclose(shift, [0.0, 0.0, 0.1], atol=1e-12)  # away from the camera
    moved = np.eye(4)
    moved[:3, 3] = shift
    np.testing.assert_allclose(moved_place(PLANE, plane, moved), [0.0, 0.0, -1.0, 0.8], atol=1e-12)


def test_a_line_is_laid_as_long_as_it_is_seen() -> None:
    place = np.array([0.0, 0.0, 1.0, 4.0, 0.0, 1.0])
    seen = np.array([1.0, 5.0, 1.0, 1.0, 6.0, 1.0])
    np.testing.assert_allclose(laid_over(place, seen), [0.5, 0.0, 1.0, 1.5, 0.0, 1.0])
    # Not beyond the end of what was stored.
    np.testing.assert_allclose(laid_over(place, seen + np.tile([9.0, 0.0, 0.0], 2)), [3.5, 0.0, 1.0, 4.5, 0.0, 1.0])
