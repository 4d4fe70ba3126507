"""The descriptor's properties, and its agreement with a second implementation that follows the paper row by row.

``reference_descriptor`` below is scalar, shares no code with the package, and was written from Zhang & Koch (2013),
section 2. It produced ``lbd_reference.json``; ``python -m tests.features.test_line_band_descriptor`` writes that file.
"""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoskill.features import line_band_descriptor
from geoskill.features.line_band_descriptor import describe

FROZEN = Path(__file__).with_name("lbd_reference.json")
SEGMENTS = [
    [20.0, 30.0, 60.0, 30.0],
    [60.0, 30.0, 20.0, 30.0],
    [40.25, 12.5, 47.75, 61.0],
    [70.0, 55.5, 30.0, 17.25],
    [5.0, 60.0, 25.5, 3.0],
    [-8.0, 40.0, 30.0, 50.0],
    [33.3, 33.3, 33.9, 33.1],
]


def synthetic_picture(height: int = 72, width: int = 80) -> np.ndarray:
    """Return waves of two directions on a ramp with a dark block, all from a formula, with gradients everywhere."""
    y, x = np.mgrid[:height, :width]
    waves = 110 + 40 * np.sin(0.23 * x + 0.11 * y) + 30 * np.cos(0.05 * x - 0.31 * y) + 0.5 * x
    waves[24:44, 30:58] -= 60
    return np.asarray(np.clip(np.round(waves), 0, 255), np.uint8)


def reference_descriptor(image: np.ndarray, segment: list[float], width: int = 7, bands: int = 9) -> list[float]:
    """Compute one descriptor by plain loops over bands, rows and samples."""
    gradient = reference_gradient(image.astype(float).tolist())
    start, end = (segment[0], segment[1]), (segment[2], segment[3])

    def row_of_gradients(distance: float) -> list[tuple[float, float]]:
        """Return gradients (across, along) at unit steps of the row at a distance to the right of the line."""
        length = math.dist(start, end)
        ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length
        right_x, right_y = -uy, ux  # facing along +x with y down, the right hand points along +y
        steps = math.ceil(length)
        row = []
        for k in range(steps):
            along = (k + 0.5) * length / steps
            gx, gy = interpolated(
                gradient, start[0] + along * ux + distance * right_x, start[1] + along * uy + distance * right_y
            )
            row.append((gx * right_x + gy * right_y, gx * ux + gy * uy))
        return row

    height = bands * width
    distances = [index - (height - 1) / 2 for index in range(height)]
    if sum(math.exp(-(d**2) / 2) * sum(across for across, _ in row_of_gradients(d)) for d in distances) < 0:
        start, end = end, start

    rows = []
    for distance in distances:
        samples = row_of_gradients(distance)
        v1 = sum(across for across, _ in samples if across > 0)
        v2 = sum(-across for across, _ in samples if across < 0)
        v3 = sum(along for _, along in samples if along > 0)
        v4 = sum(-along for _, along in samples if along < 0)
        rows.append((v1, v2, v3, v4))

    means, deviations = [], []
    for band in range(bands):
        columns = []  # of the band description matrix
        for index in range(height):
            if abs(index // width - band) > 1:
                continue
            from_line = distances[index]
            from_band = index - (band * width + (width - 1) / 2)
            sigma_global = 0.5 * (bands * width - 1)
            sigma_local = width
            weight = math.exp(-(from_line**2) / (2 * sigma_global**2)) * math.exp(
                -(from_band**2) / (2 * sigma_local**2)
            )
            columns.append([weight * v for v in rows[index]])
        assert len(columns) == (2 * width if band in (0, bands - 1) else 3 * width)
        mean = [sum(column[c] for column in columns) / len(columns) for c in range(4)]
        means.append(mean)
        deviations.append(
            [math.sqrt(sum((column[c] - mean[c]) ** 2 for column in columns) / len(columns)) for c in range(4)]
        )

    mean_norm = math.sqrt(sum(value**2 for band in means for value in band))
    deviation_norm = math.sqrt(sum(value**2 for band in deviations for value in band))
    result: list[float] = []
    for band in range(bands):
        result += [value / mean_norm for value in means[band]]
        result += [value / deviation_norm for value in deviations[band]]
    result = [min(value, 0.4) for value in result]
    norm = math.sqrt(sum(value**2 for value in result))
    return [value / norm for value in result]


def reference_gradient(image: list[list[float]]) -> dict[tuple[int, int], tuple[float, float]]:
    """Compute central differences of the picture smoothed by a Gaussian of 1 px; the border is repeated outside."""
    height, width = len(image), len(image[0])
    taps = [math.exp(-(t**2) / 2) for t in range(-4, 5)]
    taps = [tap / sum(taps) for tap in taps]

    def clamped(value: int, size: int) -> int:
        return min(max(value, 0), size - 1)

    across = [
        [sum(taps[t + 4] * row[clamped(x + t, width)] for t in range(-4, 5)) for x in range(width)] for row in image
    ]
    smooth = [
        [sum(taps[t + 4] * across[clamped(y + t, height)][x] for t in range(-4, 5)) for x in range(width)]
        for y in range(height)
    ]
    return {
        (x, y): (
            (smooth[y][clamped(x + 1, width)] - smooth[y][clamped(x - 1, width)]) / 2,
            (smooth[clamped(y + 1, height)][x] - smooth[clamped(y - 1, height)][x]) / 2,
        )
        for y in range(height)
        for x in range(width)
    }


def interpolated(gradient: dict[tuple[int, int], tuple[float, float]], x: float, y: float) -> tuple[float, float]:
    """Interpolate bilinearly between four pixels; those outside the picture have no gradient."""
    left, top = math.floor(x), math.floor(y)
    gx = gy = 0.0
    for i in (0, 1):
        for j in (0, 1):
            weight = (1 - abs(x - (left + i))) * (1 - abs(y - (top + j)))
            pixel = gradient.get((left + i, top + j), (0.0, 0.0))
            gx += weight * pixel[0]
            gy += weight * pixel[1]
    return gx, gy


def test_describe_agrees_with_the_frozen_reference() -> None:
    frozen = json.loads(FROZEN.read_text())
    assert frozen["segments"] == SEGMENTS
    np.testing.assert_allclose(describe(synthetic_picture(), np.array(SEGMENTS)), frozen["descriptors"], atol=1e-5)


@pytest.mark.parametrize("segment", SEGMENTS[3:6])
@pytest.mark.parametrize("width", [3, 9])
def test_describe_agrees_with_the_reference_for_other_band_widths(segment: list[float], width: int) -> None:
    expected = reference_descriptor(synthetic_picture(), segment, width)
    np.testing.assert_allclose(describe(synthetic_picture(), np.array([segment]), width)[0], expected, atol=1e-5)


def test_describe_a_step_edge_has_gradients_to_its_right_in_the_middle_bands_only() -> None:
    image = np.zeros((100, 100), np.uint8)
    image[50:] = 200
    bands = describe(image, np.array([[20.0, 49.5, 80.0, 49.5]])).reshape(9, 2, 4)
    # The gradient lies in band 4 (except for 1e-3 of it), so in the statistics of bands 3, 4 and 5. It has one sign and
    # one direction, so only v1 differs from zero; equal weights on both sides make it symmetric.
    assert np.all(bands[:, :, 1:] < 1e-6)
    assert np.all(bands[[2, 6]] < 1e-3)
    assert np.all(bands[[0, 1, 7, 8]] < 1e-6)
    assert np.all(bands[3:6, :, 0] > 0.1)
    np.testing.assert_allclose(bands[3], bands[5], atol=1e-6)


def test_describe_limits_the_components_of_a_step_edge() -> None:
    image = np.zeros((100, 100), np.uint8)
    image[50:] = 200
    descriptor = describe(image, np.array([[20.0, 49.5, 80.0, 49.5]]))[0]
    # All six components exceed 0.4 before limiting (three means, and three deviations, have a norm of 1 together), so
    # all become 1 / sqrt(6).
    np.testing.assert_allclose(descriptor[descriptor > 0.1], np.full(6, 6**-0.5), atol=1e-5)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.lists(st.floats(-20, 100, width=32), min_size=4, max_size=4))
def test_describe_ignores_the_order_of_end_points(coordinates: list[float]) -> None:
    segment = np.array([coordinates])
    if np.hypot(*(segment[0, 2:] - segment[0, :2])) < 1:
        return
    picture = synthetic_picture()
    np.testing.assert_allclose(describe(picture, segment), describe(picture, segment[:, [2, 3, 0, 1]]), atol=2e-5)


@pytest.mark.parametrize("quarter_turns", [1, 2, 3])
def test_describe_is_invariant_to_quarter_turns(quarter_turns: int) -> None:
    picture = synthetic_picture()
    turned, points = picture, np.array(SEGMENTS).reshape(-1, 2)
    for _ in range(quarter_turns):
        # np.rot90 turns counter-clockwise: pixel (x, y) goes to (y, width - 1 - x).
        points = np.stack([points[:, 1], turned.shape[1] - 1 - points[:, 0]], axis=1)
        turned = np.rot90(turned)
    np.testing.assert_allclose(
        describe(np.ascontiguousarray(turned), points.reshape(-1, 4)), describe(picture, np.array(SEGMENTS)), atol=2e-5
    )


def test_describe_distinguishes_a_mirrored_picture() -> None:
    picture = synthetic_picture()
    segments = np.array(SEGMENTS[2:4])
    mirrored = segments * [-1, 1, -1, 1] + [79, 0, 79, 0]
    distance = np.linalg.norm(
        describe(picture, segments) - describe(np.ascontiguousarray(picture[:, ::-1]), mirrored), axis=1
    )
    assert np.all(distance > 0.1)


def test_describe_is_invariant_to_contrast_and_brightness() -> None:
    picture = synthetic_picture() // 2
    segments = np.array(SEGMENTS)
    np.testing.assert_allclose(describe(picture, segments), describe(2 * picture + 1, segments), atol=1e-5)


def test_describe_has_unit_norm_and_keeps_the_order_across_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(0)
    segments = generator.uniform(-10, 90, (200, 4))
    whole = describe(synthetic_picture(), segments)
    assert whole.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(whole, axis=1), 1, atol=1e-6)
    monkeypatch.setattr(line_band_descriptor, "SAMPLES_PER_CHUNK", 5000)
    np.testing.assert_allclose(describe(synthetic_picture(), segments), whole, atol=1e-6)


def test_describe_a_uniform_neighborhood_or_the_outside_gives_zeros() -> None:
    outside = np.array([[500.0, 500.0, 520.0, 510.0], [-300.0, 10.0, -250.0, 10.0]])
    assert not describe(synthetic_picture(), outside).any()
    assert not describe(np.full((50, 50), 9, np.uint8), np.array([[5.0, 5.0, 40.0, 40.0]])).any()


def test_describe_no_segment() -> None:
    assert describe(synthetic_picture(), np.zeros((0, 4))).shape == (0, 72)


def test_describe_refuses_a_segment_without_length() -> None:
    with pytest.raises(ValueError, match=r"segment 1 is \[5\.0, 6\.0, 5\.0, 6\.0\], of length 0 px"):
        describe(synthetic_picture(), np.array([[0.0, 0.0, 9.0, 9.0], [5.0, 6.0, 5.0, 6.0]]))


def test_describe_refuses_coordinates_that_are_not_finite() -> None:
    with pytest.raises(ValueError, match="segment 0 has a coordinate that is not finite"):
        describe(synthetic_picture(), np.array([[0.0, np.nan, 9.0, 9.0]]))


@pytest.mark.parametrize("width", [0, 4, -3])
def test_describe_refuses_band_widths_without_a_middle_row(width: int) -> None:
    with pytest.raises(ValueError, match=f"band_width is {width}"):
        describe(synthetic_picture(), np.array(SEGMENTS), width)


def freeze() -> None:
    """Write the descriptors of the reference, rounded to seven decimals."""
    picture = synthetic_picture()
    descriptors = [[round(value, 7) for value in reference_descriptor(picture, segment)] for segment in SEGMENTS]
    FROZEN.write_text(json.dumps({"segments": SEGMENTS, "descriptors": descriptors}) + "\n")


if __name__ == "__main__":
    freeze()
