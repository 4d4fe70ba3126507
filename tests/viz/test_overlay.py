"""Tests of the overlay's pixels: positions and colors of lines, and lengths of bars."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Goal, InferenceResult, Node, NodeRole
from geoskill.skill.member_status import MemberStatus, State
from geoskill.viz.drawing import OTHER_COLORS, PAPER, TOP_COLOR, rank_color
from geoskill.viz.marks import DASH_PX
from geoskill.viz.overlay import draw_overlay
from geoskill.viz.strip import STATE_COLORS, ErrorHistory, member_color

GREY = np.full((480, 640, 3), 128, np.uint8)
# A picture of 640 pixels has a panel of 213; 853 pixels are 4/3 of those for which lengths are given.
BAR_LENGTH = 213 - 2 * 11 - 21 - 51
STRIP_HEIGHT = 133
DISC_RADIUS = 5.5  # of the mark on a point, on the top association
GREY_PICTURE = (slice(0, 480), slice(0, 640))


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


def overlay_of(
    image: np.ndarray,
    sets: Sequence[FeatureSet] = (),
    associations: Sequence[Association] = (),
    reasons: Sequence[str] = (),
    states: Mapping[str, State] | None = None,
    **settings: Any,
) -> np.ndarray:
    result = InferenceResult(
        tuple(associations),
        {str(number): features for number, features in enumerate(sets)},
        {f"p2p_sift{number}": reason for number, reason in enumerate(reasons)},
        {name: MemberStatus((f"{name}.x", f"{name}.y"), state=state) for name, state in (states or {}).items()},
    )
    return draw_overlay(image, result, **{"frame_index": 0, **settings})


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


def is_dashed(red: np.ndarray, start: tuple[float, float], end: tuple[float, float], dash: float) -> bool:
    """Return whether red pixels are near all of a segment, but for gaps as long as its dashes."""
    gaps = [np.linalg.norm(red - xy, axis=1).min() for xy in np.linspace(start, end, 300)[15:-15]]
    return 1.0 <= max(gaps) <= dash / 2 + 1.5


def test_overlay_draws_dashes_between_nodes() -> None:
    start, end = (100.0, 80.0), (400.0, 300.0)
    red = colored(overlay_of(GREY, [], [association(points(start, end))])[GREY_PICTURE], TOP_COLOR)
    distance = distance_to_segment(red, start, end)
    to_node = np.min([np.linalg.norm(red - node, axis=1) for node in (start, end)], axis=0)
    assert distance.max() <= DISC_RADIUS
    assert distance[to_node > DISC_RADIUS].max() <= 2.5
    assert is_dashed(red, start, end, DASH_PX)


def test_overlay_of_enlarged_image() -> None:
    image = np.full((160, 160, 3), 128, np.uint8)
    output = overlay_of(image, [], [association(points((20.0, 30.0), (120.0, 30.0)))])
    assert output.shape == (480 + 100, 480 + 160, 3)
    red = colored(output[:480, :480], TOP_COLOR)
    # Pixel x of the frame covers 3x to 3x + 2 of the output: its center is 3x + 1.
    assert distance_to_segment(red, (61, 91), (361, 91)).max() <= DISC_RADIUS
    assert red.mean(axis=0) == pytest.approx([211, 91], abs=0.5)


def test_overlay_draws_lines_solid_and_what_joins_them_dashed() -> None:
    first, second = (100.0, 100.0, 200.0, 100.0), (150.0, 300.0, 350.0, 300.0)
    nodes = tuple(replace(node, role=NodeRole.MOVING) for node in lines(first, second))
    red = colored(overlay_of(GREY, [], [association(nodes, kernel="l2l")])[GREY_PICTURE], TOP_COLOR)
    solid = [((100, 100), (200, 100)), ((150, 300), (350, 300))]
    dashed = ((150, 100), (250, 300))
    assert np.min([distance_to_segment(red, *part) for part in (*solid, dashed)], axis=0).max() <= 3.5
    for a, b in solid:
        assert max(np.abs(red - xy).max(axis=1).min() for xy in np.linspace(a, b, 100)) <= 1.0
    assert is_dashed(red, *dashed, DASH_PX)


@pytest.mark.parametrize(
    "nodes", [points((100.0, 200.0), (300.0, 200.0)), lines((80, 90, 80, 300), (400, 90, 400, 300))]
)
def test_overlay_draws_what_moves_solid_and_what_rests_hollow(nodes: tuple[Node, ...]) -> None:
    for roles in ((NodeRole.MOVING, NodeRole.RESTING), (NodeRole.RESTING, NodeRole.MOVING)):
        own = tuple(replace(node, role=role) for node, role in zip(nodes, roles, strict=True))
        output = overlay_of(GREY, [], [association(own)])
        for node in own:
            # Not at the middle of a line, where the dashes begin.
            x, y = (round(value) for value in (node.coordinates[0], node.coordinates[1]))
            core = tuple(output[y + (20 if len(node.coordinates) == 4 else 0), x])
            assert core == (TOP_COLOR if node.role is NodeRole.MOVING else PAPER)


def test_overlay_arrow_points_at_what_rests() -> None:
    start, end = Node(NodeType.POINT, (100.0, 200.0), role=NodeRole.MOVING), Node(NodeType.POINT, (400.0, 200.0))
    plain = colored(overlay_of(GREY, [], [association((start, end))])[GREY_PICTURE], TOP_COLOR)
    moving_first = (start, replace(end, role=NodeRole.RESTING))
    pointing = colored(overlay_of(GREY, [], [association(moving_first)])[GREY_PICTURE], TOP_COLOR)
    beside = [np.abs(red[:, 1] - 200)[(red[:, 0] > 280) & (red[:, 0] < 310)] for red in (plain, pointing)]
    assert beside[0].max() <= 2
    assert beside[1].max() >= 4
    wide = pointing[(np.abs(pointing[:, 1] - 200) >= 4) & (pointing[:, 0] > 120) & (pointing[:, 0] < 380)]
    assert 285 < wide[:, 0].mean() < 295  # its base; the tip is at 300, two thirds of the way


def test_overlay_marks_goal() -> None:
    goal = Goal(((300.0, 400.0), None), (0.0, 0.0), (1.0, 1.0))
    output = overlay_of(GREY, [], [replace(association(points((100.0, 100.0), (200.0, 100.0))), goal=goal)])
    red = colored(output[GREY_PICTURE], TOP_COLOR)
    cross = red[red[:, 1] > 200]
    assert cross.mean(axis=0) == pytest.approx([300, 400], abs=0.5)
    assert (np.abs(np.abs(cross[:, 0] - 300) - np.abs(cross[:, 1] - 400)) <= 2).all()


def test_overlay_draws_four_nodes_in_a_ring() -> None:
    corners = ((100.0, 100.0), (300.0, 300.0), (300.0, 100.0), (100.0, 300.0))
    red = colored(overlay_of(GREY, [], [association(points(*corners), kernel="copl")])[GREY_PICTURE], TOP_COLOR)
    sides = [((100, 100), (300, 100)), ((300, 100), (300, 300)), ((300, 300), (100, 300)), ((100, 300), (100, 100))]
    assert np.min([distance_to_segment(red, *side) for side in sides], axis=0).max() <= DISC_RADIUS
    assert all(is_dashed(red, *side, DASH_PX) for side in sides)


def test_overlay_links_point_and_midpoint_of_line() -> None:
    nodes = points((100.0, 100.0)) + lines((300.0, 200.0, 300.0, 400.0))
    output = overlay_of(GREY, [], [association(nodes, kernel="p2l")])
    red = colored(output[GREY_PICTURE], TOP_COLOR)
    on_link = distance_to_segment(red, (100, 100), (300, 300))
    on_line = distance_to_segment(red, (300, 200), (300, 400))
    assert np.minimum(on_link, on_line).max() <= DISC_RADIUS
    assert is_dashed(red, (110, 110), (290, 290), DASH_PX)


def test_overlay_draws_top_and_heavy_associations() -> None:
    def ranked(rank: int, confidence: float) -> Association:
        y = 50.0 * rank
        return association(points((50.0, y), (300.0, y)), rank, confidence)

    output = overlay_of(GREY, [], [ranked(1, 0.05), ranked(2, 0.11), ranked(3, 0.1)])
    picture = output[GREY_PICTURE]
    assert set(colored(picture, TOP_COLOR)[:, 1]) >= {50}
    assert set(colored(picture, OTHER_COLORS[0])[:, 1]) >= {100}
    assert len(colored(picture, OTHER_COLORS[1])) == 0
    assert (picture[140:160] == 128).all()  # the place of the third


def test_overlay_draws_top_association_thicker_and_last() -> None:
    top = association(points((100.0, 200.0), (500.0, 200.0)), 1, 0.6)
    second = association(points((300.0, 50.0), (300.0, 400.0)), 2, 0.4)
    for order in ([top, second], [second, top]):
        output = overlay_of(GREY, [], order)
        picture = output[GREY_PICTURE]
        top_pixels, second_pixels = colored(picture, TOP_COLOR), colored(picture, OTHER_COLORS[0])
        across_top = np.ptp(top_pixels[(top_pixels[:, 0] > 150) & (top_pixels[:, 0] < 250)][:, 1])
        across_second = np.ptp(second_pixels[(second_pixels[:, 1] > 80) & (second_pixels[:, 1] < 180)][:, 0])
        assert across_top > across_second
        np.testing.assert_array_equal(output, overlay_of(GREY, [], [second, top]))


def test_overlay_bars_are_as_long_as_confidences() -> None:
    ranked = [
        association(points((50.0, 50.0 * rank), (300.0, 50.0 * rank)), rank, confidence)
        for rank, confidence in ((1, 0.5), (2, 0.25), (3, 0.2))
    ]
    output = overlay_of(GREY, [], ranked)
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
    output = overlay_of(GREY, [], associations, frame_index=0, title="ensemble")
    for rank in range(1, bars + 1):
        lengths = bar_lengths(output, rank_color(rank), 640)
        assert lengths == pytest.approx([tops[kernel] / rank * BAR_LENGTH for kernel in kernels], abs=4)


def test_overlay_has_a_block_for_each_descriptor() -> None:
    nodes = points((50.0, 50.0), (300.0, 50.0))
    both = [association(nodes, descriptor="sift"), association(nodes, descriptor="orb", confidence=0.9)]
    assert len(bar_lengths(overlay_of(GREY, [], both), TOP_COLOR, 640)) == 2


def test_overlay_marks_features() -> None:
    sets = [
        feature_set(NodeType.POINT, (100.0, 100.0), (400.0, 50.0)),
        feature_set(NodeType.LINE, (200.0, 300.0, 260.0, 300.0)),
    ]
    picture = overlay_of(GREY, sets, [])[GREY_PICTURE]
    changed = np.argwhere((picture != 128).any(axis=2))[:, ::-1]
    to_points = [np.linalg.norm(changed - center, axis=1) for center in ((100, 100), (400, 50))]
    to_line = distance_to_segment(changed, (200, 300), (260, 300))
    assert np.min([*to_points, to_line], axis=0).max() <= 5.5
    assert all((distance <= 5.5).sum() >= 15 for distance in to_points)
    assert (to_line <= 1).sum() >= 60


@pytest.mark.parametrize("level", [0, 255])
def test_overlay_features_stand_out(level: int) -> None:
    image = np.full((480, 640, 3), level, np.uint8)
    picture = overlay_of(image, [feature_set(NodeType.POINT, (100.0, 100.0))], [])[GREY_PICTURE]
    assert np.abs(picture.astype(int) - level).max() >= 150


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ((240, 240), (480 + 100, 480 + 160)),
        ((480, 640), (480 + 133, 640 + 213)),
        ((239, 320), (717 + 200, 960 + 320)),
        ((720, 1280), (720 + 267, 1280 + 426)),
        ((100, 60), (800 + 100, 480 + 160)),
        ((60, 600), (480 + 250, 4800 + 1600)),
    ],
)
def test_overlay_size(shape: tuple[int, int], expected: tuple[int, int]) -> None:
    image = np.zeros((*shape, 3), np.uint8)
    some = [association(points((5.0, 5.0), (40.0, 40.0)), rank, 0.2, k) for k in ("p2p", "p2l") for rank in range(1, 6)]
    outputs = [
        overlay_of(image, [], []),
        overlay_of(image, [], some, frame_index=123456, title="a title " * 30, reasons=["no feature " * 40] * 5),
    ]
    assert [output.shape for output in outputs] == [(*expected, 3)] * 2
    assert all(output.dtype == np.uint8 for output in outputs)
    picture_width = image.shape[1] * (480 // min(shape) + (480 % min(shape) > 0))
    assert 3 * (expected[1] - picture_width) <= picture_width  # text takes at most a quarter


@pytest.mark.parametrize("side", [240, 480])
def test_overlay_is_repeatable_and_leaves_input_alone(side: int) -> None:
    image = np.random.default_rng(0).integers(0, 256, (side, side, 3), dtype=np.uint8)
    before = image.copy()
    image.flags.writeable = False
    sets = [feature_set(NodeType.POINT, (100.0, 100.0))]
    ranked = [association(points((10.0, 10.0), (200.0, 200.0)))]
    first = overlay_of(image, sets, ranked)
    np.testing.assert_array_equal(image, before)
    np.testing.assert_array_equal(overlay_of(image, sets, ranked), first)


def test_overlay_panel_shows_frame_time_title_states_and_reasons() -> None:
    plain = overlay_of(GREY, frame_index=1)
    for changed in (
        overlay_of(GREY, frame_index=2),
        overlay_of(GREY, frame_index=1, time_s=0.5),
        overlay_of(GREY, frame_index=1, title="sorting"),
        overlay_of(GREY, frame_index=1, reasons=["1 feature; expected at least 2"]),
        overlay_of(GREY, frame_index=1, states={"p2p_sift": State.LOST}),
    ):
        assert (changed[:, 640:] != plain[:, 640:]).any()
        np.testing.assert_array_equal(changed[:, :640], plain[:, :640])


def test_overlay_clips_associations_at_border() -> None:
    output = overlay_of(GREY, [], [association(points((-50.0, 200.0), (900.0, 200.0)))])
    red = colored(output, TOP_COLOR)
    on_row = red[red[:, 1] == 200][:, 0]
    assert on_row.min() <= DASH_PX
    assert on_row[on_row < 640].max() >= 640 - DASH_PX
    # The panel's margin beside the picture stays white.
    np.testing.assert_array_equal(output[:, 640:650], overlay_of(GREY)[:, 640:650])


def history_of(norms: Sequence[float | None], total: int | None, state: State = State.APPROACHING) -> ErrorHistory:
    history = ErrorHistory(total)
    for norm in norms:
        own = () if norm is None else (replace(association(points((1, 1), (9, 9))), error=(norm, 0.0)),)
        status = MemberStatus(("p2p_sift.x", "p2p_sift.y"), state=State.LOST if norm is None else state)
        history.add(InferenceResult(own, {}, {}, {"p2p_sift": status}))
    return history


def test_strip_draws_errors_over_known_number_of_frames() -> None:
    """Ten frames from 90 px to 0, with a gap; the curve covers half of the width after half of the frames."""
    norms = [90.0, 80.0, 70.0, None, 50.0, 40.0, 30.0, 20.0, 10.0, 0.0]
    for count, share in ((10, 1.0), (5, 4 / 9)):
        strip = overlay_of(GREY, history=history_of(norms[:count], 10))[480:, :640]
        curve = colored(strip[26:-10], member_color(0))
        assert (curve[:, 0].min(), curve[:, 0].max()) == pytest.approx((11, 11 + share * 618), abs=3)
    between = curve[(curve[:, 0] > 11 + 2.2 * 618 / 9) & (curve[:, 0] < 11 + 3.8 * 618 / 9)]
    assert len(between) == 0
    full = colored(overlay_of(GREY, history=history_of(norms, 10))[480:, :640], member_color(0))
    first, last = (full[np.abs(full[:, 0] - x) < 2][:, 1] for x in (14, 622))
    assert first.min() < 45  # 90 of 100 px
    assert last.min() > 100


def test_strip_colors_states_below_the_curve() -> None:
    history = history_of([5.0, 5.0, 5.0], 3, State.AT_GOAL)
    strip = overlay_of(GREY, history=history)[480:, :640]
    band = colored(strip, STATE_COLORS[State.AT_GOAL])
    assert np.ptp(band[:, 0]) == pytest.approx(618, abs=3)
    assert band[:, 1].min() > 110
    assert len(colored(overlay_of(GREY, history=history_of([5.0], 3))[480:, :640], STATE_COLORS[State.AT_GOAL])) == 0


def test_strip_of_endless_source_shows_last_frames() -> None:
    history = history_of([100.0, *[1.0] * 300], None)
    assert history.scales() == {"px": 1.0}  # the first one has left
    assert history.place == 1.0
    ((norms, states),) = history.curves()
    assert len(norms) == len(states) == 300
    assert (norms == 1.0).all()
