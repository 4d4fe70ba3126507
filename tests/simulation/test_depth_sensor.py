"""Depth as a sensor measures it: its noise, its holes, and that it is repeatable."""

from typing import Any

import numpy as np
import pytest

from geoskill.geometry.camera import PinholeCamera
from geoskill.simulation.depth_sensor import NOISE_PER_M, depth_camera, recorded_depth, sense_depth
from geoskill.simulation.recording import Recording

CAMERA = PinholeCamera(321, 241, 330.0, np.eye(4))


def facing(depth: float) -> Any:
    return np.full((241, 321), depth, np.float32)


@pytest.mark.parametrize(
    ("sensor", "depth", "std_m"), [("d435", 0.5, 0.9e-3), ("d435", 0.7, 1.8e-3), ("d405", 0.35, 1.25e-3)]
)
def test_noise_has_the_standard_deviation_of_the_sensor(sensor: str, depth: float, std_m: float) -> None:
    sensed = sense_depth(facing(depth), CAMERA, NOISE_PER_M[sensor], np.random.default_rng(0))
    noise = sensed - depth
    assert np.isfinite(noise).all()
    assert noise.std() == pytest.approx(std_m, rel=0.04)
    assert depth_camera(CAMERA, NOISE_PER_M[sensor]).depth_std_m(np.array([depth])) == pytest.approx(std_m, rel=0.04)
    assert abs(noise.mean()) < 0.05 * std_m
    # Of two windows of 5 pixels in a row, as many pixels are the same as the windows overlap.
    alike = [float(np.mean(noise[:, :-lag] * noise[:, lag:]) / noise.var()) for lag in (1, 2, 5, 8)]
    assert alike == pytest.approx([0.8, 0.6, 0.0, 0.0], abs=0.05)


def test_perfect_sensor_has_no_noise_and_no_holes() -> None:
    depth = facing(0.6)
    depth[100:120, 100:140] = 0.4
    np.testing.assert_array_equal(sense_depth(depth, CAMERA, 0.0, np.random.default_rng(0)), depth)


def test_nothing_is_measured_around_an_edge() -> None:
    depth = facing(0.6)
    depth[:, 200:] = 0.55
    holes = np.isnan(sense_depth(depth, CAMERA, NOISE_PER_M["d435"], np.random.default_rng(0)))
    columns = np.flatnonzero(holes.all(axis=0))
    assert (columns.min(), columns.max()) == (196, 203)  # the edge is between 199 and 200, three more to either side
    assert holes.sum() == 8 * 241
    # A step of 5 mm is no edge.
    depth[:, 200:] = 0.595
    assert np.isfinite(sense_depth(depth, CAMERA, NOISE_PER_M["d435"], np.random.default_rng(0))).all()


@pytest.mark.parametrize(("angle_deg", "measured"), [(0, True), (60, True), (76, True), (80, False)])
def test_nothing_is_measured_at_a_flat_angle(angle_deg: float, measured: bool) -> None:
    # A plane through (0, 0, 0.6), turned about the y axis: z = 0.6 + x tan(angle), along the rays x = z (u - cx) / f.
    slope = np.tan(np.radians(angle_deg))
    columns = (np.arange(321) - 160) / 330.0
    depth = np.tile((0.6 / (1 - columns * slope)).astype(np.float32), (241, 1))
    sensed = sense_depth(depth, CAMERA, NOISE_PER_M["d435"], np.random.default_rng(0))
    assert bool(np.isfinite(sensed[120, 160])) is measured


def test_recorded_depth_depends_on_frame_seed_and_episode_alone(hand_made_recording: Recording) -> None:
    first = recorded_depth(hand_made_recording, 0, "d435", 3, "robot")
    np.testing.assert_array_equal(first, recorded_depth(hand_made_recording, 0, "d435", 3, "robot"))
    for other in ((0, "d435", 4, "robot"), (0, "d435", 3, "human"), (1, "d435", 3, "robot"), (0, "d405", 3, "robot")):
        assert not np.array_equal(first, recorded_depth(hand_made_recording, *other), equal_nan=True)
    perfect = recorded_depth(hand_made_recording, 0, "perfect", 3, "robot")
    np.testing.assert_array_equal(perfect, hand_made_recording.depth_m(0))
