import random

import cv2
import numpy as np
import pytest

from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.geometry.primitives import NodeType


def keypoint(x: float, y: float, response: float, angle: float = 0.0, size: float = 5.0) -> cv2.KeyPoint:
    return cv2.KeyPoint(x, y, size, angle, response)


def as_tuples(keypoints: list[cv2.KeyPoint]) -> list[tuple[float, ...]]:
    return [(*k.pt, k.response, k.angle) for k in keypoints]


def test_the_strongest_of_each_corner_is_kept_strongest_first() -> None:
    found = [
        keypoint(3.0, 4.0, 0.25),
        keypoint(3.25, 3.75, 0.75, angle=90.0),  # the same corner, stronger
        keypoint(3.0, 4.125, 0.5),  # the same corner, weaker
        keypoint(4.0, 4.0, 0.125),  # its neighbor
        keypoint(4.0, 3.0, 1.0),
    ]
    assert as_tuples(distinct_keypoints(found)) == [(4, 3, 1, 0), (3.25, 3.75, 0.75, 90), (4, 4, 0.125, 0)]


def test_small_keypoints_are_the_same_within_half_a_pixel() -> None:
    assert len(distinct_keypoints([keypoint(7.0, 7.0, 1.0), keypoint(7.5, 7.0, 0.5)])) == 1
    assert len(distinct_keypoints([keypoint(7.0, 7.0, 1.0), keypoint(7.5625, 7.0, 0.5)])) == 2


@pytest.mark.parametrize(("stronger", "weaker"), [(31.0, 62.0), (62.0, 31.0)])
def test_large_keypoints_are_the_same_within_a_share_of_the_larger_one(stronger: float, weaker: float) -> None:
    """0.05 of 62 px is 3.1 px: what two pyramid levels make of one corner."""
    first = keypoint(50.0, 50.0, 1.0, size=stronger)
    assert len(distinct_keypoints([first, keypoint(53.0, 50.0, 0.5, size=weaker)])) == 1
    assert len(distinct_keypoints([first, keypoint(53.25, 50.0, 0.5, size=weaker)])) == 2


def test_the_order_in_which_threads_deliver_does_not_matter() -> None:
    numbers = random.Random(0)
    found = [
        keypoint(numbers.randrange(4), numbers.randrange(4), numbers.randrange(3), angle=numbers.randrange(360))
        for _ in range(200)
    ]
    expected = as_tuples(distinct_keypoints(found))
    assert len(expected) == 16
    for _ in range(10):
        numbers.shuffle(found)
        assert as_tuples(distinct_keypoints(found)) == expected


def test_keypoints_become_a_feature_set() -> None:
    descriptors = np.array([[0.6, 0.8], [1.0, 0.0]], np.float32).T.copy().T
    assert not descriptors.flags.c_contiguous
    features = keypoint_features([keypoint(1.5, 2.25, 0.5), keypoint(7, 8, 0.25, angle=90.0)], descriptors, 3.0)
    assert features.node_type is NodeType.POINT
    assert features.geometry.tolist() == [[1.5, 2.25], [7.0, 8.0]]
    assert features.strength.tolist() == [0.5, 0.25]
    np.testing.assert_array_equal(features.descriptors, descriptors)
    assert features.descriptors.flags.c_contiguous
    assert features.arms is not None
    np.testing.assert_allclose(features.arms, [[15, 0], [0, 15]], atol=1e-5)  # three diameters; 90 degrees is down
    assert {a.dtype for a in (features.descriptors, features.geometry, features.strength)} == {np.dtype(np.float32)}


def test_no_keypoint_becomes_an_empty_feature_set() -> None:
    assert distinct_keypoints([]) == []
    assert keypoint_features([], np.zeros((0, 32), np.float32), 3.0).geometry.shape == (0, 2)
