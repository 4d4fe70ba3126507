"""The LBD extractor, and how reliably its descriptors match edges in a warped picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.features.lbd import Lbd
from geoskill.geometry.primitives import NodeType

SIZE = 480
FEATURE_COUNT = 80
# (rotation in degrees, scale, two perspective terms in 1/px about the picture's center)
WARPS = [
    (10, 1.0, 0, 0),
    (-20, 1.0, 0, 0),
    (30, 1.0, 0, 0),
    (0, 0.7, 0, 0),
    (0, 0.85, 0, 0),
    (0, 1.2, 0, 0),
    (0, 1.4, 0, 0),
    (0, 1.0, 3e-4, 0),
    (0, 1.0, 0, -4e-4),
    (15, 0.8, 2e-4, 1e-4),
    (-25, 1.3, 0, 2e-4),
    (30, 0.7, 0, 0),
    (-30, 1.4, 0, 0),
]


def textured_picture(seed: int) -> np.ndarray:
    """Draw many overlapping rectangles of all sizes, gray levels and directions, with noise."""
    generator = np.random.default_rng(seed)
    image = np.full((SIZE, SIZE), 128, np.uint8)
    for _ in range(140):
        center, size = generator.uniform(0, SIZE, 2), generator.uniform(10, 70, 2)
        corners = cv2.boxPoints((tuple(center), tuple(size), generator.uniform(0, 180)))
        gray = int(generator.integers(20, 235))
        cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], gray, cv2.LINE_AA, 4)
    noisy = cv2.GaussianBlur(image, (0, 0), 1.0) + generator.normal(0, 3, image.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def frames(blocks: Path) -> list[np.ndarray]:
    """Return frames as the pipeline sees them: gray and enlarged to twice their size."""
    paths = [blocks / "human1" / "0000.jpg", blocks / "robot1" / "0150.jpg"]
    small = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8) for path in paths]
    return [np.asarray(cv2.resize(image, (SIZE, SIZE), interpolation=cv2.INTER_CUBIC), np.uint8) for image in small]


def homography(rotation_deg: float, scale: float, perspective_x: float, perspective_y: float) -> np.ndarray:
    """Return a homography about the picture's center."""
    c, s = scale * np.cos(np.radians(rotation_deg)), scale * np.sin(np.radians(rotation_deg))
    to_center = np.array([[1, 0, -(SIZE - 1) / 2], [0, 1, -(SIZE - 1) / 2], [0, 0, 1]])
    about_origin = np.array([[c, -s, 0], [s, c, 0], [perspective_x, perspective_y, 1]])
    return np.asarray(np.linalg.inv(to_center) @ about_origin @ to_center)


def warped(segments: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return cv2.perspectiveTransform(segments.reshape(-1, 1, 2).astype(np.float64), matrix).reshape(-1, 4)


def seen_by_both(features: FeatureSet, matrix: np.ndarray) -> FeatureSet:
    """Return the strongest features that lie wholly in the other view; outside it, the warp only repeats the border."""
    segments = warped(features.geometry, matrix)
    return features.take(np.flatnonzero(np.all((segments >= 0) & (segments <= SIZE - 1), axis=1))[:FEATURE_COUNT])


def same_edge(expected: np.ndarray, matched: np.ndarray) -> np.ndarray:
    """Return whether segments lie on one edge.

    Both ends of ``expected`` must be within 5 px of the line through ``matched``, the directions must differ by no more
    than 10 degrees, and the segments must overlap along the line.
    """
    along = matched[:, 2:] - matched[:, :2]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    ends = expected.reshape(-1, 2, 2) - matched[:, None, :2]
    across = np.abs(along[:, None, 0] * ends[..., 1] - along[:, None, 1] * ends[..., 0])
    position = np.einsum("nij,nj->ni", ends, along)
    overlap = np.minimum(position.max(axis=1), length) - np.maximum(position.min(axis=1), 0)
    direction = ends[:, 1] - ends[:, 0]
    cosine = np.abs(np.sum(direction * along, axis=1)) / np.linalg.norm(direction, axis=1)
    return np.asarray((across.max(axis=1) <= 5) & (overlap > 0) & (cosine >= np.cos(np.radians(10))))


def matches(image: np.ndarray, matrix: np.ndarray, extractor: Lbd) -> tuple[np.ndarray, np.ndarray]:
    """Return mutual nearest neighbors of a picture and its warp: the expected and the matched segments."""
    other = cv2.warpPerspective(image, matrix, (SIZE, SIZE), borderMode=cv2.BORDER_REPLICATE)
    first = seen_by_both(extractor.extract(image), matrix)
    second = seen_by_both(extractor.extract(other), np.linalg.inv(matrix))
    similarity = first.descriptors @ second.descriptors.T  # of unit vectors: the order of L2 distances
    nearest = similarity.argmax(axis=1)
    mutual = similarity.argmax(axis=0)[nearest] == np.arange(len(first))
    return warped(first.geometry, matrix)[mutual], second.geometry[nearest[mutual]]


def right_ratio(images: Sequence[np.ndarray]) -> tuple[float, float, str]:
    """Return the ratio of right matches over all warps, the same for shuffled matches, and a report."""
    extractor, right, shuffled, lines = Lbd(), [], [], []
    for warp in WARPS:
        pairs = [matches(image, homography(*warp), extractor) for image in images]
        right_of_warp = np.concatenate([same_edge(expected, matched) for expected, matched in pairs])
        shuffled.append(
            np.concatenate([same_edge(expected, np.roll(matched, 1, axis=0)) for expected, matched in pairs])
        )
        right.append(right_of_warp)
        lines.append(f"{warp}: {right_of_warp.mean():.3f} of {len(right_of_warp)}")
    pooled = np.concatenate(right)
    lines.append(f"pooled: {pooled.mean():.3f} of {len(pooled)}")
    return float(pooled.mean()), float(np.concatenate(shuffled).mean()), "\n".join(lines)


def check_repeatability(images: Sequence[np.ndarray]) -> None:
    ratio, by_chance, report = right_ratio(images)
    print(report)
    assert ratio >= 0.85, report
    assert by_chance < 0.1, "the criterion accepts pairs that were not matched"


@pytest.mark.slow
def test_edges_of_real_frames_are_matched_after_warps(blocks: Path) -> None:
    check_repeatability(frames(blocks))


@pytest.mark.slow
def test_edges_of_a_textured_picture_are_matched_after_warps() -> None:
    check_repeatability([textured_picture(0)])


def test_same_edge_criterion() -> None:
    segment = np.array([[0.0, 0.0, 40.0, 0.0]])
    cases = {
        (40, 0, 0, 0): True,  # the order of end points carries no meaning
        (30, 4, 60, 1): True,
        (0, 6, 40, 0): False,  # one end is 6 px off
        (41, 0, 60, 0): False,  # no overlap
        (10, 0, 20, 3): False,  # 17 degrees
    }
    for expected, answer in cases.items():
        assert same_edge(np.array([expected], float), segment).item() is answer, expected


def test_extract_returns_sorted_unit_descriptors_of_long_segments() -> None:
    features = Lbd(min_length_ratio=0.03).extract(textured_picture(1))
    assert features.node_type is NodeType.LINE
    assert features.descriptors.shape == (len(features), Lbd.descriptor_dim)
    assert len(features) > 40
    np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1, atol=1e-6)
    assert np.all(np.diff(features.scores) <= 0)
    assert features.scores[-1] >= 0.03 * SIZE * 2**0.5
    everything = Lbd(min_length_ratio=0.0).extract(textured_picture(1))
    assert len(everything) > len(features)
    np.testing.assert_array_equal(everything.descriptors[: len(features)], features.descriptors)


def test_band_width_changes_the_descriptor() -> None:
    picture = textured_picture(1)
    narrow, wide = Lbd(band_width=3).extract(picture), Lbd(band_width=11).extract(picture)
    np.testing.assert_array_equal(narrow.geometry, wide.geometry)
    assert np.abs(narrow.descriptors - wide.descriptors).max() > 0.1


@pytest.mark.parametrize("shape", [(60, 80), (2, 2), (0, 0)])
def test_extract_from_a_picture_without_edges_is_empty(shape: tuple[int, int]) -> None:
    features = Lbd().extract(np.full(shape, 90, np.uint8))
    assert len(features) == 0
    assert features.descriptors.shape == (0, 72)
    assert features.geometry.shape == (0, 4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"min_length_ratio": 20.0}, "min_length_ratio is 20.0; expected a fraction"),
        ({"min_length_ratio": -0.1}, "min_length_ratio is -0.1; expected a fraction"),
        ({"band_width": 6}, "band_width is 6; expected an odd number of pixels from 1 to 63"),
        ({"band_width": 65}, "band_width is 65; expected an odd number of pixels from 1 to 63"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Lbd(**arguments)
