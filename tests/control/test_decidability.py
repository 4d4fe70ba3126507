"""The table of ranks, the names of what is free, and the report."""

import numpy as np
import pytest

from geoskill.control.action import UPRIGHT, Dof
from geoskill.control.decidability import Decidability, decidability, rank_of
from geoskill.control.placed import Placed, picture_rows, space_rows
from geoskill.control.points_plant import points_cameras
from geoskill.geometry.poses import rotation_about
from tests.control.small_loops import L2L, P2L, P2P, PAR

CAMERAS = points_cameras(2)


def placed(name: str, rng: np.random.Generator) -> Placed:
    """A constraint that holds, at random on a thing of the size of a hand."""

    def point() -> np.ndarray:
        return rng.uniform(-0.06, 0.06, (1, 3)) + np.array([0.0, 0.0, 0.06])

    def along(through: np.ndarray, direction: np.ndarray) -> np.ndarray:
        return np.concatenate([through - 0.04 * direction, through + 0.05 * direction])

    direction = rng.normal(size=(1, 3))
    direction /= np.linalg.norm(direction)
    first, other = point(), point()
    if name == "p2p":
        return Placed(P2P, name, (first, first), (True, False))
    if name == "p2l":
        return Placed(P2L, name, (first, along(first, direction)), (True, False))
    if name == "l2l":
        return Placed(L2L, name, (along(first, direction), along(first + 0.01 * direction, direction)), (True, False))
    if name == "par":
        return Placed(PAR, name, (along(first, direction), along(other, direction)), (True, False))
    plane = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    corners = [first + rng.uniform(-0.06, 0.06, (1, 2)) @ plane for _ in range(4)]
    return Placed(None, name, tuple(corners), (True, True, False, False))


TABLE = [
    ("p2p", "2 2 3 3 3 3"),
    ("p2p p2p", "4 4 5 4 5 4"),
    ("p2p p2p p2p", "6 4 6 4 6 4"),
    ("p2p p2p l2l", "6 4 6 4 6 4"),
    ("p2l", "1 1 2 2 2 2"),
    ("p2l p2l", "2 2 4 4 4 4"),
    ("p2l p2l p2l", "3 3 6 4 6 4"),
    ("p2l p2l p2l p2l p2l p2l", "6 4 6 4 6 4"),
    ("l2l", "2 2 4 3 4 3"),
    ("l2l l2l", "4 3 6 4 6 4"),
    ("l2l l2l l2l", "6 4 6 4 6 4"),
    ("p2p l2l", "4 4 6 4 6 4"),
    ("p2p p2l", "3 3 5 4 5 4"),
    ("par", "1 1 2 2 2 1"),
    ("par par", "2 2 4 4 3 1"),
    ("p2p par", "3 3 5 4 5 4"),
    ("p2p par par", "4 4 6 4 6 4"),
    ("copl", "0 0 0 0 1 1"),
    ("copl copl copl", "0 0 0 0 3 3"),
    ("l2l copl", "2 2 4 3 5 4"),
    ("p2p copl copl", "2 2 3 3 5 4"),
    ("p2p l2l copl", "4 4 6 4 6 4"),
]


@pytest.mark.parametrize(("names", "expected"), TABLE, ids=[names for names, _ in TABLE])
def test_ranks(names: str, expected: str) -> None:
    columns = [list(Dof).index(dof) for dof in UPRIGHT]
    for seed in range(5):
        rng = np.random.default_rng([seed, len(names)])
        own = [placed(name, rng) for name in names.split()]
        grip = np.array([0.01, 0.03, 0.08])
        views = [picture_rows(own, camera, grip) for camera in CAMERAS]
        space = space_rows(own, grip)
        assert space is not None
        found = []
        for rows in (views[0], np.concatenate(views), space):
            found += [rank_of(rows), rank_of(rows[:, columns])]
        assert " ".join(map(str, found)) == expected


def test_point_on_the_line_adds_one_less() -> None:
    rng = np.random.default_rng(0)
    line = placed("l2l", rng)
    on_it = line.nodes[0][:1]
    own = [line, Placed(P2P, "p2p", (on_it, on_it), (True, False))]
    rows = space_rows(own, np.zeros(3))
    assert rows is not None
    assert rank_of(rows) == 5


def test_p2p_leaves_rotations_through_its_point() -> None:
    report = decidability([placed("p2p", np.random.default_rng(1))], CAMERAS)
    assert report.depth is not None
    assert report.depth.free == ("rotation about the vertical through the point of p2p",)
    assert report.all_axes == (2, 3, 3)
    assert (report.one_camera.rank, report.one_camera.of) == (2, 4)


def test_l2l_leaves_its_line() -> None:
    up = np.array([[0.0, 0.0, 0.05], [0.0, 0.0, 0.12]])
    report = decidability([Placed(L2L, "l2l", (up, up), (True, False))], CAMERAS)
    assert report.depth is not None
    assert report.depth.free == (
        "translation along the vertical",
        "rotation about the vertical through the line of l2l",
    )


def test_free_motions_leave_the_errors_at_zero() -> None:
    """Carrying out the motion that is said to be free, by 10 degrees, leaves the point where it was."""
    own = placed("p2p", np.random.default_rng(2))
    point = own.nodes[0][0]
    turned = point + rotation_about(np.array([0.0, 0.0, 0.17])) @ (point - point)
    np.testing.assert_allclose(turned, point)


def test_what_one_camera_determines_badly_is_the_line_of_sight() -> None:
    rng = np.random.default_rng(3)
    near = [Placed(P2P, "p2p", (own, own), (True, False)) for own in rng.uniform(-0.02, 0.02, (3, 1, 3))]
    report = decidability(near, CAMERAS)
    assert report.one_camera.rank == 4
    assert any(name == "the line of sight" for name, _, _ in report.one_camera.weak), report.one_camera.weak
    assert not any(name == "the line of sight" for name, _, _ in report.two_cameras.weak)
    assert report.statement.startswith("with one camera, as the thing is rigid")


def test_report_is_plain_and_one_line() -> None:
    report: Decidability = decidability([placed("par", np.random.default_rng(4))], CAMERAS)
    plain = report.as_plain()
    assert plain["one_camera"]["of"] == 4
    assert plain["all_six_axes"] == [1, 2, 2]
    assert "par only where the lines are at one depth" in plain["decidable"]
    assert "\n" not in report.as_text()
    assert report.as_text().startswith("determined: 1 of 4 | free: ")


def test_no_constraint_is_refused() -> None:
    with pytest.raises(ValueError, match="no constraint; expected at least one"):
        decidability([], CAMERAS)
