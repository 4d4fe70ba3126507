"""Rigid poses: known values, an independent reference, and inverses."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from geoskill.geometry.poses import (
    inverse,
    pose,
    quaternion,
    rotation_about,
    rotation_vector,
    table_pose,
    transform,
)

COORDINATE = st.floats(-3, 3)
AXIS = st.tuples(*[st.floats(-1, 1)] * 3).map(np.array).filter(lambda axis: np.linalg.norm(axis) > 1e-3)
POSE = st.builds(
    lambda position, axis, angle: pose(position, rotation_about(angle * axis / np.linalg.norm(axis))),
    st.tuples(COORDINATE, COORDINATE, COORDINATE),
    AXIS,
    st.floats(-10, 10),
)


@pytest.mark.parametrize(
    ("vector", "start", "end"),
    [
        ((0, 0, math.pi / 2), (1, 0, 0), (0, 1, 0)),
        ((math.pi / 2, 0, 0), (0, 1, 0), (0, 0, 1)),
        ((0, math.pi / 2, 0), (0, 0, 1), (1, 0, 0)),
        ((0, 0, math.pi), (1, 2, 3), (-1, -2, 3)),
        ((0, 0, 0), (1, 2, 3), (1, 2, 3)),
        # A third of a turn about the diagonal permutes the axes.
        (np.full(3, 2 * math.pi / 3 / math.sqrt(3)), (1, 2, 3), (3, 1, 2)),
    ],
)
def test_rotation_about_gives_known_rotations(
    vector: tuple[float, ...], start: tuple[float, ...], end: tuple[float, ...]
) -> None:
    turned = rotation_about(np.array(vector, float)) @ np.array(start, float)
    np.testing.assert_allclose(turned, end, atol=1e-12)


@given(AXIS, st.floats(-10, 10))
def test_rotation_about_and_quaternion_agree_with_rodrigues_formula(axis: np.ndarray, angle: float) -> None:
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    expected = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
    rotation = rotation_about(angle * np.array([x, y, z]))
    np.testing.assert_allclose(rotation, expected, atol=1e-12)
    w = math.cos(angle / 2)
    assume(abs(w) > 1e-6)  # at a half turn, both signs are right
    expected_quaternion = math.copysign(1.0, w) * np.array([w, *(math.sin(angle / 2) * np.array([x, y, z]))])
    np.testing.assert_allclose(quaternion(rotation), expected_quaternion, atol=1e-9)


# Beyond a half turn, the smaller rotation is the opposite one. Just below it, the rotation is almost symmetric.
@given(AXIS, st.one_of(st.floats(0, math.pi), st.floats(1e-12, 1e-3).map(lambda rest: math.pi - rest)))
def test_rotation_vector_inverts_rotation_about(axis: np.ndarray, angle: float) -> None:
    vector = angle * axis / np.linalg.norm(axis)
    recovered = rotation_vector(rotation_about(vector))
    assert np.linalg.norm(recovered) <= math.pi + 1e-12
    np.testing.assert_allclose(rotation_about(recovered), rotation_about(vector), atol=1e-7)
    if angle < math.pi - 1e-2:
        np.testing.assert_allclose(recovered, vector, atol=1e-7)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, -0.8), (-0.48, 0.6, 0.64)])
def test_rotation_vector_of_a_half_turn_has_either_sign(axis: tuple[float, ...]) -> None:
    direction = np.array(axis, float)
    # Without Rodrigues' formula: a half turn keeps the component along the axis and negates the rest.
    recovered = rotation_vector(2 * np.outer(direction, direction) - np.eye(3))
    assert np.linalg.norm(recovered) == pytest.approx(math.pi)
    assert abs(recovered @ direction) == pytest.approx(math.pi)


def test_rotation_vector_of_the_identity_and_of_a_tiny_rotation() -> None:
    np.testing.assert_array_equal(rotation_vector(np.eye(3)), np.zeros(3))
    tiny = np.array([1e-9, -2e-9, 3e-9])
    np.testing.assert_allclose(rotation_vector(rotation_about(tiny)), tiny, rtol=1e-6)


@given(POSE)
def test_inverse_of_a_pose(matrix: np.ndarray) -> None:
    np.testing.assert_allclose(matrix @ inverse(matrix), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(matrix), np.linalg.inv(matrix), atol=1e-12)


@given(POSE, POSE, st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), max_size=3))
def test_transforms_compose_and_keep_distances(
    outer: np.ndarray, inner: np.ndarray, rows: list[tuple[float, float, float]]
) -> None:
    points = np.array(rows, float).reshape(-1, 3)
    moved = transform(outer @ inner, points)
    np.testing.assert_allclose(moved, transform(outer, transform(inner, points)), atol=1e-12)
    lengths = np.linalg.norm(np.diff(moved, axis=0), axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(points, axis=0), axis=1), atol=1e-12)


def test_table_pose_has_known_coordinates() -> None:
    body_pose = table_pose(0.1, -0.2, math.pi / 2, 0.3)
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 1]])
    np.testing.assert_allclose(
        transform(body_pose, corners), [[0.1, -0.2, 0.3], [0.1, 0.8, 0.3], [-0.9, -0.2, 1.3]], atol=1e-12
    )
    np.testing.assert_allclose(quaternion(body_pose[:3, :3]), [math.sqrt(0.5), 0, 0, math.sqrt(0.5)], atol=1e-12)
    np.testing.assert_array_equal(quaternion(np.eye(3)), [1, 0, 0, 0])
