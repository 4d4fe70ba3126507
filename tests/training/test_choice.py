"""Which constraints a demonstration is about, for a thing of five points and four lines that is carried to a target."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, final

import numpy as np
import pytest
import torch

from geoskill.data.transitions import Transition, Transitions
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.par import Parallel
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.tracking.motion import Part, Trajectory
from geoskill.training.choice import choose
from geoskill.training.coincidences import NOTHING, coincidences
from geoskill.training.picture_rank import picture_rank

POINT, LINE = NodeType.POINT, NodeType.LINE
# The thing's features where they end, beside the target's, in pixels. The points are at random.
POINTS = np.array([[30, 20], [-35, 10], [5, -40], [-20, 38], [42, -25]], np.float64)
OTHER_POINTS = np.array([[60, 55], [-65, -20], [18, 70], [-15, -75], [75, -5]], np.float64)
# Three stripes at angles of their own, which the target's go on with.
ANGLES = (0.1, 0.9, 1.9)


def stripe(angle: float, offset: float, begin: float, end: float) -> list[float]:
    along, across = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
    return [*(offset * across + begin * along), *(offset * across + end * along)]


STRIPES = np.array([stripe(angle, 9.0 * number, -30, 30) for number, angle in enumerate(ANGLES)])
GO_ON = np.array([stripe(angle, 9.0 * number, 45, 95) for number, angle in enumerate(ANGLES)])
ASIDE = np.array([stripe(angle + 0.35 + number, 60 + 9 * number, -20, 40) for number, angle in enumerate(ANGLES)])


def carried(geometry: np.ndarray, turn: float, shift: tuple[float, float]) -> np.ndarray:
    matrix = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    return (geometry.reshape(len(geometry), geometry.shape[1] // 2, 2) @ matrix.T + shift).reshape(geometry.shape)


def member(kernel: Kernel) -> KernelModel:
    extractors = {kind: {POINT: "sift", LINE: "lbd"}[kind] for kind in node_types(kernel)}
    return KernelModel(kernel, extractors, Bilinear(Motif.of(kernel, dict.fromkeys(extractors, 4)), hidden_dim=2))


MEMBERS = {
    name: member(kernel)
    for name, kernel in {
        "p2p_sift": PointToPoint(),
        "p2l_sift_lbd": PointToLine(),
        "l2l_lbd": LineToLine(),
        "par_lbd": Parallel(),
    }.items()
}
Scene = Mapping[NodeType, tuple[np.ndarray, np.ndarray]]


def frame(own: KernelModel, scene: Scene, left: float) -> MotifGraph:
    """The thing with a share of its way left, which is a turn by 0.6 and a shift by 300 px; the target rests."""
    features, trajectories = {}, {}
    for kind in own.node_types:
        ends, target = scene[kind]
        now, start = (carried(ends, 0.6 * share, (300.0 * share, 90.0 * share)) for share in (left, 1.0))
        rows = [np.concatenate([thing, target]).astype(np.float32) for thing in (now, start, ends)]
        count = len(rows[0])
        descriptors = np.eye(4, dtype=np.float32)[np.arange(count) % 4]
        features[kind] = FeatureSet(kind, descriptors, rows[0], np.zeros(count, np.float32))
        trajectories[kind] = Trajectory(
            torch.from_numpy(rows[1])[:, None],
            torch.zeros(count, dtype=torch.int64),
            torch.from_numpy(rows[2]),
            torch.ones(count, dtype=torch.bool),
            torch.full((count,), Part.UNKNOWN),
        )
    graph = motif_graph(own.kernel, features, None, trajectories)
    graph.span_index = torch.tensor([0])
    return graph


@final
class Shown(Transitions):
    """Eight frames of a scene, for every member."""

    def __init__(self, members: Mapping[str, KernelModel], scene: Scene) -> None:
        self._graphs = {name: [frame(own, scene, 1 - t / 8) for t in range(8)] for name, own in members.items()}

    @property
    def spans(self) -> tuple[int, ...]:
        return (2,)

    def __len__(self) -> int:
        return 8

    def __getitem__(self, index: int) -> Transition:
        raise NotImplementedError

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        return self._graphs[name][index]

    def frames(self, name: str) -> Iterator[MotifGraph]:
        raise NotImplementedError

    def descriptors(self, name: str) -> dict[NodeType, torch.Tensor]:
        raise NotImplementedError


def chosen(scene: Scene, members: Mapping[str, KernelModel] = MEMBERS) -> tuple[Sequence[str], Mapping[str, str]]:
    choice = choose(members, Shown(members, scene))
    assert {*choice.kept, *choice.dropped} == set(members)
    return choice.kept, choice.dropped


MEETING = np.concatenate([POINTS[:2], OTHER_POINTS])


def test_choice_of_a_thing_whose_stripes_the_target_goes_on_with() -> None:
    kept, dropped = chosen({POINT: (POINTS, MEETING), LINE: (STRIPES, GO_ON)})
    assert kept == ("p2p_sift", "l2l_lbd")
    assert dropped["par_lbd"] == "fixes nothing that l2l_lbd and p2p_sift left free"


def test_choice_of_a_thing_whose_lines_say_nothing() -> None:
    kept, dropped = chosen({POINT: (POINTS, MEETING), LINE: (STRIPES, ASIDE)})
    assert kept == ("p2p_sift",)
    assert dropped["l2l_lbd"].startswith(("no more come together than by chance", "its associations come together in"))


def test_choice_does_not_depend_on_the_order_of_the_candidates() -> None:
    scene = {POINT: (POINTS, MEETING), LINE: (STRIPES, GO_ON)}
    kept, dropped = chosen(scene, dict(reversed(MEMBERS.items())))
    assert set(kept) == {"p2p_sift", "l2l_lbd"}
    assert dropped == chosen(scene)[1]


def test_choice_of_one_kernel_with_two_descriptors() -> None:
    members = {"p2p_orb": MEMBERS["p2p_sift"], "p2p_sift": MEMBERS["p2p_sift"]}
    assert chosen({POINT: (POINTS, MEETING)}, members) == (("p2p_orb",), {"p2p_sift": "p2p_orb says the same"})


def test_choice_where_nothing_comes_together() -> None:
    far = {POINT: (POINTS + 2000.0, MEETING), LINE: (STRIPES + 2000.0, ASIDE)}
    kept, dropped = chosen(far)
    assert len(kept) == 1
    assert all(reason == "its associations come together in 0% of the frames only" for reason in dropped.values())


def test_choice_leaves_out_what_has_no_association() -> None:
    nothing = np.zeros((0, 4))
    kept, dropped = chosen({POINT: (POINTS, MEETING), LINE: (nothing, nothing)})
    assert kept == ("p2p_sift",)
    assert dropped["l2l_lbd"] == "its associations come together in 0% of the frames only"


def test_coincidences_by_hand() -> None:
    """Of two points 60 px apart, one meets the target; hardly any turn and shift would bring either to it."""
    scene = {POINT: (np.array([[0.0, 0.0], [60.0, 0.0]]), np.array([[60.0, 0.0]]))}
    found = coincidences(MEMBERS["p2p_sift"], frame(MEMBERS["p2p_sift"], scene, 0.5), torch.Generator().manual_seed(0))
    before = math.hypot(*(carried(scene[POINT][0], 0.6, (300.0, 90.0))[1] - (60.0, 0.0)))
    assert found.progress == pytest.approx(math.log((before + 4) / 4) / (1 + math.log((before + 4) / 4)), rel=1e-4)
    assert 0.01 <= found.chance <= 0.1


@pytest.mark.parametrize(
    ("names", "rank", "shifts"),
    [
        ([], 0, 0),
        (["p2p_sift"], 2, 2),
        (["p2l_sift_lbd"], 1, 1),
        (["l2l_lbd"], 2, 1),
        (["par_lbd"], 1, 0),
        (["p2p_sift", "p2p_sift"], 4, 2),
        (["p2p_sift", "l2l_lbd"], 4, 2),
        (["p2p_sift", "p2l_sift_lbd"], 3, 2),
        (["p2p_sift", "par_lbd"], 3, 2),
        (["p2l_sift_lbd"] * 3, 3, 2),
        (["l2l_lbd", "par_lbd"], 2, 1),
        (["l2l_lbd", "p2l_sift_lbd"], 3, 2),
        (["l2l_lbd", "l2l_lbd"], 3, 2),
    ],
)
def test_picture_rank(names: list[str], rank: int, shifts: int) -> None:
    """Those of one camera and a thing that moves along x, y, z and turns about the vertical."""
    kernels = [MEMBERS[name].kernel for name in names]
    assert (picture_rank(kernels), picture_rank(kernels, shifts_only=True)) == (rank, shifts)


@pytest.mark.parametrize("left", [0.0, 1.0])
def test_coincidences_without_a_pair(left: float) -> None:
    graph = frame(MEMBERS["p2p_sift"], {POINT: (POINTS[:0], MEETING)}, left)
    found: Any = coincidences(MEMBERS["p2p_sift"], graph, torch.Generator())
    assert found is NOTHING
