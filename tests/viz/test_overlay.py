"""Tests of the overlay's pixels: positions and colors of lines, and lengths of bars."""

import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node
from geoskill.viz.drawing import OTHER_COLORS, TOP_COLOR, rank_color
from geoskill.viz.overlay import draw_overlay

GREY = np.full((480, 640, 3), 128, np.uint8)
PANEL_WIDTH = 272
BAR_LENGTH = 272 - 2 * 14 - 22 - 50
DISC_RADIUS = 5.0  # of the mark on a point, on the top association


def points(*xy: tuple[float, float]) -> tuple[Node, ...]:
    return tuple(Node(NodeType.POINT, pair) for pair in xy)


def lines(*xyxy: tuple[float, float, float, float]) -> tuple[Node, ...]:
    return tuple(Node(NodeType.LINE, row) for row in xyxy)


def association(
    nodes: tuple[Node, ...], rank: int = 1, confidence: float = 0.5, kernel: str = "p2p", descriptor: str = "sift"
) -> Association:
    member = "_".join([kernel, *descriptor.split("+")])
    return Association(member, kernel, descriptor, rank, confidence, confidence, nodes, (3.0, -4.0))


def feature_set(node_type: NodeType, *rows: tuple[float, ...]) -> FeatureSet:
    geometry = np.array(rows, np.float32)
    return FeatureSet(node_type, np.ones((len(rows), 1), np.float32), geometry, np.ones(len(rows), np.float32))


def colored(image: np.ndarray, color: tuple[int, int, int]) -> np.ndarray:
    """Return x, y of the pixels that have exactly this color, ``[k, 2]``."""
    return np.argwhere((image == color).all(axis=2))[:, ::-1]


def distance_to_segment(xy: np.ndarray, start: tuple[float, float], end: tuple[float, float]) -> np.ndarray:
    a, b = np.asarray(start, float), np.asarray(end, float)
    along = np.clip((xy - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.asarray(np.linalg.norm(xy - (a + along[:, None] * (b - a)), axis=1))


def bar_lengths(output: np.ndarray, color: tuple[int, int, int], picture_width: int) -> list[int]:
    """Return the lengths of the horizontal bars of a color in the panel, from the top."""
    filled = (output[:, picture_width:] == color).all(axis=2).sum(axis=1)
    rows = np.flatnonzero(filled >= 10)
    groups = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(rows) else []
    return [int(np.bincount(filled[group]).argmax()) for group in groups if len(group) >= 5]


def test_overlay_draws_segment_between_nodes() -> None:
    start, end = (100.0, 80.0), (400.0, 300.0)
    output = draw_overlay(GREY, [], [association(points(start, end))], frame_index=0)
    red = colored(output[:, :640], TOP_COLOR)
    distance = distance_to_segment(red, start, end)
    to_node = np.min([np.linalg.norm(red - node, axis=1) for node in (start, end)], axis=0)
    assert distance.max() <= DISC_RADIUS
    assert distance[to_node > DISC_RADIUS].max() <= 2.5
    along = np.linspace(0, 1, 300)[:, None]
    for xy in np.asarray(start) + along * (np.asarray(end) - start):
        assert np.abs(red - xy).max(axis=1).min() <= 1.0


def test_overlay_of_enlarged_image() -> None:
    image = np.full((160, 160, 3), 128, np.uint8)
    output = draw_overlay(image, [], [association(points((20.0, 30.0), (120.0, 30.0)))], frame_index=0)
    assert output.shape[:2] == (480, 480 + PANEL_WIDTH)
    red = colored(output[:, :480], TOP_COLOR)
    # Pixel x of the frame covers 3x to 3x + 2 of the output: its center is 3x + 1.
    assert distance_to_segment(red, (61, 91), (361, 91)).max() <= DISC_RADIUS
    assert red.mean(axis=0) == pytest.approx([211, 91], abs=0.1)


def test_overlay_links_midpoints_of_lines() -> None:
    first, second = (100.0, 100.0, 200.0, 100.0), (150.0, 300.0, 350.0, 300.0)
    output = draw_overlay(GREY, [], [association(lines(first, second), kernel="l2l")], frame_index=0)
    red = colored(output[:, :640], TOP_COLOR)
    parts = [((100, 100), (200, 100)), ((150, 300), (350, 300)), ((150, 100), (250, 300))]
    distances = np.array([distance_to_segment(red, *part) for part in parts])
    assert distances.min(axis=0).max() <= 3.5
    for a, b in parts:
        for xy in np.linspace(a, b, 100):
            assert np.abs(red - xy).max(axis=1).min() <= 1.0


def test_overlay_links_point_and_midpoint_of_line() -> None:
    nodes = points((100.0, 100.0)) + lines((300.0, 200.0, 300.0, 400.0))
    output = draw_overlay(GREY, [], [association(nodes, kernel="p2l")], frame_index=0)
    red = colored(output[:, :640], TOP_COLOR)
    on_link = distance_to_segment(red, (100, 100), (300, 300))
    on_line = distance_to_segment(red, (300, 200), (300, 400))
    assert np.minimum(on_link, on_line).max() <= DISC_RADIUS
    assert np.abs(red - (200, 200)).max(axis=1).min() <= 1.0


def test_overlay_links_four_nodes_in_a_ring() -> None:
    corners = ((100.0, 100.0), (300.0, 300.0), (300.0, 100.0), (100.0, 300.0))
    output = draw_overlay(GREY, [], [association(points(*corners), kernel="copl")], frame_index=0)
    red = colored(output[:, :640], TOP_COLOR)
    sides = [((100, 100), (300, 100)), ((300, 100), (300, 300)), ((300, 300), (100, 300)), ((100, 300), (100, 100))]
    assert np.min([distance_to_segment(red, *side) for side in sides], axis=0).max() <= DISC_RADIUS
    for a, b in sides:
        assert np.abs(red - np.mean([a, b], axis=0)).max(axis=1).min() <= 1.0


def test_overlay_draws_top_and_heavy_associations() -> None:
    def ranked(rank: int, confidence: float) -> Association:
        y = 50.0 * rank
        return association(points((50.0, y), (300.0, y)), rank, confidence)

    output = draw_overlay(GREY, [], [ranked(1, 0.05), ranked(2, 0.11), ranked(3, 0.1)], frame_index=0)
    picture = output[:, :640]
    assert set(colored(picture, TOP_COLOR)[:, 1]) >= {50}
    assert set(colored(picture, OTHER_COLORS[0])[:, 1]) >= {100}
    assert len(colored(output, OTHER_COLORS[1])) == 0
    assert (picture[140:160] == 128).all()  # the place of the third


def test_overlay_draws_top_association_thicker_and_last() -> None:
    top = association(points((100.0, 200.0), (500.0, 200.0)), 1, 0.6)
    second = association(points((300.0, 50.0), (300.0, 400.0)), 2, 0.4)
    for order in ([top, second], [second, top]):
        output = draw_overlay(GREY, [], order, frame_index=0)
        assert tuple(output[200, 300]) == TOP_COLOR
        across_top = (output[:, 200] == TOP_COLOR).all(axis=1).sum()
        across_second = (output[100, :640] == OTHER_COLORS[0]).all(axis=1).sum()
        assert across_top > across_second >= 1


def test_overlay_bars_are_as_long_as_confidences() -> None:
    ranked = [
        association(points((50.0, 50.0 * rank), (300.0, 50.0 * rank)), rank, confidence)
        for rank, confidence in ((1, 0.5), (2, 0.25), (3, 0.2))
    ]
    output = draw_overlay(GREY, [], ranked, frame_index=0)
    for rank, confidence in ((1, 0.5), (2, 0.25), (3, 0.2)):
        (length,) = bar_lengths(output, rank_color(rank), 640)
        assert length == pytest.approx(confidence * BAR_LENGTH, abs=2)


@pytest.mark.parametrize("bars", [1, 3])
def test_overlay_has_a_block_for_each_kernel(bars: int) -> None:
    kernels = ("p2p", "p2l", "l2l", "copl")
    tops = {"p2p": 0.6, "p2l": 0.5, "l2l": 0.4, "copl": 0.35}
    associations = [
        association(points((50.0 * rank, 40.0), (50.0 * rank, 300.0)), rank, tops[kernel] / rank, kernel)
        for kernel in kernels
        for rank in range(1, bars + 1)
    ]
    output = draw_overlay(GREY, [], associations, frame_index=0, title="ensemble")
    for rank in range(1, bars + 1):
        lengths = bar_lengths(output, rank_color(rank), 640)
        assert lengths == pytest.approx([tops[kernel] / rank * BAR_LENGTH for kernel in kernels], abs=4)


def test_overlay_has_a_block_for_each_descriptor() -> None:
    nodes = points((50.0, 50.0), (300.0, 50.0))
    both = [association(nodes, descriptor="sift"), association(nodes, descriptor="orb", confidence=0.9)]
    assert len(bar_lengths(draw_overlay(GREY, [], both, frame_index=0), TOP_COLOR, 640)) == 2


def test_overlay_marks_features() -> None:
    sets = [
        feature_set(NodeType.POINT, (100.0, 100.0), (400.0, 50.0)),
        feature_set(NodeType.LINE, (200.0, 300.0, 260.0, 300.0)),
    ]
    picture = draw_overlay(GREY, sets, [], frame_index=0)[:, :640]
    changed = np.argwhere((picture != 128).any(axis=2))[:, ::-1]
    to_points = [np.linalg.norm(changed - center, axis=1) for center in ((100, 100), (400, 50))]
    to_line = distance_to_segment(changed, (200, 300), (260, 300))
    assert np.min([*to_points, to_line], axis=0).max() <= 5.5
    assert all((distance <= 5.5).sum() >= 15 for distance in to_points)
    assert (to_line <= 1).sum() >= 60


@pytest.mark.parametrize("level", [0, 255])
def test_overlay_features_stand_out(level: int) -> None:
    image = np.full((480, 640, 3), level, np.uint8)
    picture = draw_overlay(image, [feature_set(NodeType.POINT, (100.0, 100.0))], [], frame_index=0)[:, :640]
    assert np.abs(picture.astype(int) - level).max() >= 150


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((240, 240), (480, 480 + 272)),
        ((480, 640), (480, 640 + 272)),
        ((239, 320), (717, 960 + round(272 * 717 / 480))),
        ((960, 1280), (960, 1280 + 2 * 272)),
        ((100, 60), (800, 480 + 272)),
    ],
)
def test_overlay_size(shape: tuple[int, int], expected: tuple[int, int]) -> None:
    image = np.zeros((*shape, 3), np.uint8)
    some = [association(points((5.0, 5.0), (40.0, 40.0)), rank, 0.2, k) for k in ("p2p", "p2l") for rank in range(1, 6)]
    outputs = [
        draw_overlay(image, [], [], frame_index=0),
        draw_overlay(image, [], some, frame_index=123456, title="a title " * 30, reasons=["no feature " * 40] * 5),
    ]
    assert [output.shape for output in outputs] == [(*expected, 3)] * 2
    assert all(output.dtype == np.uint8 for output in outputs)


@pytest.mark.parametrize("side", [240, 480])
def test_overlay_is_repeatable_and_leaves_input_alone(side: int) -> None:
    image = np.random.default_rng(0).integers(0, 256, (side, side, 3), dtype=np.uint8)
    before = image.copy()
    image.flags.writeable = False
    sets = [feature_set(NodeType.POINT, (100.0, 100.0))]
    ranked = [association(points((10.0, 10.0), (200.0, 200.0)))]
    first = draw_overlay(image, sets, ranked, frame_index=0)
    np.testing.assert_array_equal(image, before)
    np.testing.assert_array_equal(draw_overlay(image, sets, ranked, frame_index=0), first)


def test_overlay_panel_shows_frame_title_and_reasons() -> None:
    plain = draw_overlay(GREY, [], [], frame_index=1)
    for changed in (
        draw_overlay(GREY, [], [], frame_index=2),
        draw_overlay(GREY, [], [], frame_index=1, title="sorting"),
        draw_overlay(GREY, [], [], frame_index=1, reasons=["p2p sift: 1 feature; expected at least 2"]),
        draw_overlay(GREY, [], [association((), rank=0, confidence=0.0)], frame_index=1),
    ):
        assert (changed[:, 640:] != plain[:, 640:]).any()
        np.testing.assert_array_equal(changed[:, :640], GREY)


def test_overlay_clips_associations_at_border() -> None:
    output = draw_overlay(GREY, [], [association(points((-50.0, 200.0), (900.0, 200.0)))], frame_index=0)
    assert tuple(output[200, 0]) == TOP_COLOR
    assert tuple(output[200, 639]) == TOP_COLOR
    empty = draw_overlay(GREY, [], [], frame_index=0)
    # The panel's margin beside the picture stays white.
    np.testing.assert_array_equal(output[:, 640:654], empty[:, 640:654])
