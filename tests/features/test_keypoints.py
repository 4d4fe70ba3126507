"""Removal of duplicate keypoints, and their conversion to feature sets."""

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


def test_distinct_keypoints_keeps_the_strongest_of_each_corner() -> None:
    keypoints = [
        keypoint(3.0, 4.0, 0.25),
        keypoint(3.25, 3.75, 0.75, angle=90.0),  # the same corner, stronger
        keypoint(3.0, 4.125, 0.5),  # the same corner, weaker
        keypoint(4.0, 4.0, 0.125),  # its neighbor
        keypoint(4.0, 3.0, 1.0),
    ]
    assert as_tuples(distinct_keypoints(keypoints)) == [(4, 3, 1, 0), (3.25, 3.75, 0.75, 90), (4, 4, 0.125, 0)]


def test_distinct_keypoints_merges_small_ones_within_half_a_pixel() -> None:
    assert len(distinct_keypoints([keypoint(7.0, 7.0, 1.0), keypoint(7.5, 7.0, 0.5)])) == 1
    assert len(distinct_keypoints([keypoint(7.0, 7.0, 1.0), keypoint(7.5625, 7.0, 0.5)])) == 2


@pytest.mark.parametrize(("stronger", "weaker"), [(31.0, 62.0), (62.0, 31.0)])
def test_distinct_keypoints_merges_large_ones_within_a_fraction_of_the_larger_diameter(
    stronger: float, weaker: float
) -> None:
    """0.05 of 62 px is 3.1 px: the distance at which two pyramid levels place one corner."""
    first = keypoint(50.0, 50.0, 1.0, size=stronger)
    assert len(distinct_keypoints([first, keypoint(53.0, 50.0, 0.5, size=weaker)])) == 1
    assert len(distinct_keypoints([first, keypoint(53.25, 50.0, 0.5, size=weaker)])) == 2


def test_distinct_keypoints_does_not_depend_on_the_order() -> None:
    numbers = random.Random(0)
    keypoints = [
        keypoint(numbers.randrange(4), numbers.randrange(4), numbers.randrange(3), angle=numbers.randrange(360))
        for _ in range(200)
    ]
    expected = as_tuples(distinct_keypoints(keypoints))
    assert len(expected) == 16
    for _ in range(10):
        numbers.shuffle(keypoints)
        assert as_tuples(distinct_keypoints(keypoints)) == expected


def test_keypoint_features() -> None:
    descriptors = np.array([[0.6, 0.8], [1.0, 0.0]], np.float32).T.copy().T
    assert not descriptors.flags.c_contiguous
    features = keypoint_features([keypoint(1.5, 2.25, 0.5), keypoint(7, 8, 0.25, angle=90.0)], descriptors, 3.0)
    assert features.node_type is NodeType.POINT
    assert features.geometry.tolist() == [[1.5, 2.25], [7.0, 8.0]]
    assert features.scores.tolist() == [0.5, 0.25]
    np.testing.assert_array_equal(features.descriptors, descriptors)
    assert features.descriptors.flags.c_contiguous
    assert features.orientation_px is not None
    np.testing.assert_allclose(
        features.orientation_px, [[15, 0], [0, 15]], atol=1e-5
    )  # three diameters; 90 degrees is down
    assert {a.dtype for a in (features.descriptors, features.geometry, features.scores)} == {np.dtype(np.float32)}


def test_keypoint_features_of_no_keypoint() -> None:
    assert distinct_keypoints([]) == []
    assert keypoint_features([], np.zeros((0, 32), np.float32), 3.0).geometry.shape == (0, 2)
