"""The pipeline around an extractor: gray, enlargement and its inverse, the limit, colors, the cache."""

from pathlib import Path
from typing import ClassVar, final

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.color import COLOR_DIM, colors_around
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.lbd import Lbd
from geoskill.features.orb import Orb
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType
from geoskill.io.disk_cache import DiskCache


@final
class PictureCorners(FeatureExtractor):
    """An extractor that finds the top left and bottom right corners and the center of any picture."""

    name: ClassVar[str] = "picture_corners"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 2

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def extract(self, image: np.ndarray, limit: int | None = None) -> FeatureSet:
        self.seen.append(image)
        height, width = image.shape
        geometry = np.array([[-0.5, -0.5], [width - 0.5, height - 0.5], [(width - 1) / 2, (height - 1) / 2]])
        return FeatureSet(
            self.node_type,
            np.ones((3, 2), np.float32) / np.sqrt(np.float32(2)),
            geometry.astype(np.float32),
            np.array([3, 2, 1], np.float32),
        )


@final
class Diagonal(FeatureExtractor):
    """An extractor that finds the diagonal of any picture."""

    name: ClassVar[str] = "diagonal"
    node_type: ClassVar[NodeType] = NodeType.LINE
    descriptor_dim: ClassVar[int] = 1

    def extract(self, image: np.ndarray, limit: int | None = None) -> FeatureSet:
        height, width = image.shape
        line = np.array([[-0.5, -0.5, width - 0.5, height - 0.5]], np.float32)
        return FeatureSet(self.node_type, np.ones((1, 1), np.float32), line, np.ones(1, np.float32))


def frame_of(height: int, width: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


def blob(x: float, y: float, sigma: float, height: int, width: int) -> np.ndarray:
    rows, columns = np.mgrid[:height, :width]
    gray = 200 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * sigma**2))
    return np.repeat(np.round(gray).astype(np.uint8)[:, :, None], 3, axis=2)


@given(height=st.integers(2, 70), width=st.integers(2, 70), min_side=st.integers(0, 100))
def test_extract_converts_points_to_the_frames_pixels(height: int, width: int, min_side: int) -> None:
    pipeline = FeaturePipeline(PictureCorners(), max_features=5, min_side=min_side)
    found = pipeline.extract(frame_of(height, width)).geometry
    expected = [[-0.5, -0.5], [width - 0.5, height - 0.5], [(width - 1) / 2, (height - 1) / 2]]
    np.testing.assert_allclose(found, expected, atol=1e-4)
    assert found.dtype == np.float32


def test_extract_converts_lines_to_the_frames_pixels() -> None:
    found = FeaturePipeline(Diagonal(), max_features=5, min_side=90).extract(frame_of(30, 50))
    np.testing.assert_allclose(found.geometry, [[-0.5, -0.5, 49.5, 29.5]], atol=1e-4)
    assert found.node_type is NodeType.LINE


@pytest.mark.parametrize(
    ("min_side", "expected"),
    [(0, (40, 60)), (30, (40, 60)), (40, (40, 60)), (80, (80, 120)), (50, (50, 75)), (46, (46, 69))],
)
def test_min_side_enlarges_and_never_reduces(min_side: int, expected: tuple[int, int]) -> None:
    extractor = PictureCorners()
    FeaturePipeline(extractor, max_features=2, min_side=min_side).extract(frame_of(40, 60))
    assert extractor.seen[0].shape == expected
    assert extractor.seen[0].dtype == np.uint8


def test_extractor_receives_the_luminance_of_the_rgb_frame() -> None:
    extractor = PictureCorners()
    frame = np.zeros((1, 3, 3), np.uint8)
    frame[0, 0, 0] = frame[0, 1, 1] = frame[0, 2, 2] = 255
    FeaturePipeline(extractor, max_features=2, min_side=0).extract(frame)
    assert extractor.seen[0].tolist() == [[76, 150, 29]]  # 0.299, 0.587 and 0.114 of 255


@pytest.mark.parametrize("min_side", [0, 113, 200, 300])
def test_extract_finds_a_blob_at_its_center_at_every_scale(min_side: int) -> None:
    frame = blob(45.25, 61.5, sigma=3.0, height=100, width=121)
    found = FeaturePipeline(Sift(), max_features=5, min_side=min_side).extract(frame)
    np.testing.assert_allclose(found.geometry[0], [45.25, 61.5], atol=0.06)


@pytest.mark.parametrize("min_side", [240, 301])
def test_min_side_does_not_shift_the_corners_of_a_square(min_side: int) -> None:
    frame = np.zeros((120, 120, 3), np.uint8)
    frame[40:80, 40:80] = 200  # between the edges 39.5 and 79.5: symmetric about 59.5
    geometry = FeaturePipeline(Orb(), max_features=500, min_side=min_side).extract(frame).geometry
    np.testing.assert_allclose((geometry.min(axis=0) + geometry.max(axis=0)) / 2, [59.5, 59.5], atol=0.25)
    corners = np.array([[39.5, 39.5], [39.5, 79.5], [79.5, 39.5], [79.5, 79.5]])
    assert (np.abs(geometry[:, None] - corners).max(axis=2).min(axis=0) < 1.0).all()


def test_max_features_keeps_the_highest_scores() -> None:
    frame = np.repeat(cv2.GaussianBlur(frame_of(120, 120)[:, :, :1], (0, 0), 2)[:, :, None], 3, axis=2)
    many = FeaturePipeline(Sift(), max_features=1000, min_side=0).extract(frame)
    few = FeaturePipeline(Sift(), max_features=7, min_side=0).extract(frame)
    assert len(many) > 7 == len(few)
    assert np.all(np.diff(many.scores) <= 0)
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(few, name), getattr(many, name)[:7])


@pytest.mark.parametrize("extractor", [Sift(), Orb(), Lbd()])
def test_limit_leaves_out_the_lowest_scores_and_changes_nothing_else(extractor: FeatureExtractor) -> None:
    image = cv2.GaussianBlur(frame_of(240, 240)[:, :, 0], (0, 0), 2)
    everything, few = extractor.extract(image), extractor.extract(image, 7)
    assert len(everything) > 7 == len(few)
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(few, name), getattr(everything, name)[:7])
    assert len(extractor.extract(image, 10**6)) == len(everything)


def test_extract_does_not_keep_other_features_in_memory() -> None:
    few = FeaturePipeline(PictureCorners(), max_features=2, min_side=0).extract(frame_of(10, 10))
    for name in ("descriptors", "geometry", "scores"):
        array = getattr(few, name)
        assert array.base is None or array.base.nbytes == array.nbytes, name


@pytest.mark.parametrize("extractor", [Sift(), Orb()])
def test_extract_from_a_black_frame_is_empty(extractor: FeatureExtractor) -> None:
    found = FeaturePipeline(extractor, max_features=10, min_side=200).extract(np.zeros((100, 90, 3), np.uint8))
    assert found.descriptors.shape == (0, extractor.descriptor_dim)
    assert found.geometry.shape == (0, 2)


def test_identity_depends_on_every_setting_and_the_version_of_opencv(monkeypatch: pytest.MonkeyPatch) -> None:
    def identity(extractor: FeatureExtractor, max_features: int = 60, min_side: int = 480, color: float = 0.0) -> str:
        return FeaturePipeline(extractor, max_features=max_features, min_side=min_side, color=color).identity

    default = identity(Sift())
    assert default == identity(Sift())
    changed = [
        identity(Sift(root=True)),
        identity(Sift(contrast_threshold=0.02)),
        identity(Orb()),
        identity(Orb(candidates=1000)),
        identity(Orb(fast_threshold=20)),
        identity(Sift(), max_features=61),
        identity(Sift(), min_side=0),
        identity(Sift(), max_features=6, min_side=0),
        identity(Sift(), color=1.0),
        identity(Sift(), color=2.0),
    ]
    monkeypatch.setattr(cv2, "__version__", "99.0.0")
    changed.append(identity(Sift()))
    assert len({default, *changed}) == len(changed) + 1


def test_cache_extracts_a_frame_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texture = cv2.GaussianBlur(frame_of(80, 80), (0, 0), 2)
    first = FeaturePipeline(Sift(), max_features=9, min_side=160).extract(texture)
    cached = FeaturePipeline(Sift(), max_features=9, min_side=160, cache=FeatureCache(DiskCache(tmp_path)))
    stored = cached.extract(texture)
    monkeypatch.setattr(Sift, "extract", None)  # calling it would fail
    again = cached.extract(texture.copy())
    assert len(first) == 9
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(first, name))
        np.testing.assert_array_equal(getattr(again, name), getattr(first, name))
    with pytest.raises(TypeError):
        cached.extract(255 - texture)


@pytest.mark.parametrize("max_features", [1, 0, -4])
def test_max_features_below_two_is_refused(max_features: int) -> None:
    with pytest.raises(InputError, match=rf"^max_features={max_features}: expected at least 2$"):
        FeaturePipeline(Sift(), max_features=max_features, min_side=0)


@pytest.mark.parametrize("shape", [(720, 1280), (1280, 720), (1080, 1920), (2160, 1215)])
def test_max_side_reduces_large_pictures_and_keeps_coordinates(shape: tuple[int, int]) -> None:
    frame = np.full((*shape, 3), 60, np.uint8)
    square = np.array([200.5, 300.5])  # its top left corner, between pixels
    frame[301:501, 201:401] = 200
    pipeline = FeaturePipeline(Orb(), max_features=500, min_side=480, max_side=720)
    geometry = pipeline.extract(frame).geometry
    # The detector itself is some two pixels inside.
    assert np.abs(geometry - square).max(axis=1).min() < 2.5 * min(shape) / 720
    whole = FeaturePipeline(Orb(), max_features=500, min_side=480).extract(frame)
    assert (len(geometry) == len(whole) and np.array_equal(geometry, whole.geometry)) == (min(shape) == 720)


@pytest.mark.parametrize("max_side", [-1, 479])
def test_max_side_below_min_side_is_refused(max_side: int) -> None:
    with pytest.raises(InputError, match=rf"^max_side={max_side}: expected 0 .* or at least min_side=480$"):
        FeaturePipeline(Sift(), max_features=2, min_side=480, max_side=max_side)


def test_negative_min_side_is_refused() -> None:
    with pytest.raises(InputError, match=r"^min_side=-1: expected 0 \(never enlarge\) or a number of pixels$"):
        FeaturePipeline(Sift(), max_features=2, min_side=-1)


def test_color_appends_colors_to_the_descriptor() -> None:
    picture = np.random.default_rng(5).integers(0, 255, (12, 16, 3), np.uint8)
    picture = cv2.resize(picture, (160, 120), interpolation=cv2.INTER_CUBIC)
    gray = FeaturePipeline(Sift(), max_features=20, min_side=0)
    colored = FeaturePipeline(Sift(), max_features=20, min_side=0, color=2.0)
    assert (gray.descriptor_dim, colored.descriptor_dim) == (128, 128 + COLOR_DIM)
    plain, found = gray.extract(picture), colored.extract(picture)
    np.testing.assert_array_equal(found.geometry, plain.geometry)
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1, atol=1e-5)
    # Descriptor and colors in the ratio given by `color`.
    detected = Sift().extract(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), 20)
    assert detected.orientation_px is not None
    colors = colors_around(picture, detected.geometry, detected.orientation_px)
    scale = np.linalg.norm(found.descriptors[:, :128], axis=1, keepdims=True)
    np.testing.assert_allclose(found.descriptors[:, :128] / scale, plain.descriptors, atol=1e-5)
    np.testing.assert_allclose(found.descriptors[:, 128:] / scale, 2 * colors, atol=1e-5)


def test_colors_do_not_depend_on_min_side() -> None:
    picture = np.full((60, 60, 3), (150, 40, 40), np.uint8)
    cv2.circle(picture, (30, 30), 8, (40, 40, 150), -1)
    for min_side in (0, 240):
        found = FeaturePipeline(Sift(), max_features=2, min_side=min_side, color=1.0).extract(picture)
        row = int(np.argmin(np.linalg.norm(found.geometry - 30, axis=1)))
        center, *around = found.descriptors[row, 128:].reshape(5, 2)
        assert center[1] < 0 < min(sample[1] for sample in around)  # blue inside, red outside


def test_color_of_lines_and_of_no_features() -> None:
    frame = np.zeros((100, 90, 3), np.uint8)
    lines = FeaturePipeline(Lbd(), max_features=5, min_side=0, color=3.0)
    assert lines.extract(frame).descriptors.shape == (0, lines.descriptor_dim) == (0, Lbd.descriptor_dim)
    points = FeaturePipeline(Orb(), max_features=5, min_side=0, color=3.0)
    assert points.extract(frame).descriptors.shape == (0, points.descriptor_dim) == (0, 256 + COLOR_DIM)


def test_negative_color_is_refused() -> None:
    with pytest.raises(InputError, match=r"^color=-1: expected 0 \(none\) or more$"):
        FeaturePipeline(Sift(), max_features=2, min_side=0, color=-1)


@pytest.mark.parametrize(
    ("shape", "enlarged"),
    [
        ((30, 40), (60, 80)),
        ((30, 120), (60, 240)),  # four squares
        ((20, 320), (30, 480)),
        ((1, 200), (8, 1697)),
        ((200, 1), (1697, 8)),
        ((61, 500), (61, 500)),
    ],
)
def test_strips_are_enlarged_no_further_than_other_pictures(shape: tuple[int, int], enlarged: tuple[int, int]) -> None:
    """With a ``min_side`` of 60, to no more than 4 x 60 x 60 pixels."""
    seen = []

    @final
    class Looks(FeatureExtractor):
        name: ClassVar[str] = "looks"
        node_type: ClassVar[NodeType] = NodeType.POINT
        descriptor_dim: ClassVar[int] = 4

        def extract(self, image: np.ndarray, limit: int | None = None) -> FeatureSet:
            seen.append(image.shape)
            return FeatureSet.empty(self.node_type, self.descriptor_dim)

    FeaturePipeline(Looks(), max_features=2, min_side=60).extract(np.zeros((*shape, 3), np.uint8))
    assert seen == [enlarged]
