"""What is done with pictures and requests."""

import contextlib
import json
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill import Servo, Skill
from geoskill.errors import InputError
from geoskill.exports.messages import Kind, Request, encoded, parse_request
from geoskill.exports.record import NeutralRecord
from geoskill.exports.session import Driver, LiveSession, Observer, View, Watcher
from geoskill.skill.association import InferenceResult
from tests.exports.requests import damaged_request

Frames = Sequence[np.ndarray]


class Log:
    """What was written, view by view."""

    def __init__(self) -> None:
        self.records: list[NeutralRecord] = []

    def __call__(self, view: View, results: Sequence[InferenceResult], record: NeutralRecord) -> None:
        self.records.append(record)


class Remembering(Watcher):
    """Nothing but what it is told of displacements."""

    def __init__(self, dofs: Sequence[str] = ("x", "yaw")) -> None:
        self.dofs = dofs
        self.told: list[tuple[Any, bool]] = []

    def look(
        self, view: View, acted: np.ndarray | None, touched: bool
    ) -> tuple[Sequence[InferenceResult], NeutralRecord]:
        self.told.append((None if acted is None else acted.round(6).tolist(), touched))
        return [InferenceResult(())], {"state": "servo"}


def frame(picture: np.ndarray, **fields: Any) -> Request:
    return Request(Kind.FRAME, (picture,), **fields)


@pytest.fixture(scope="module")
def skill(small_skill: Path) -> Skill:
    return Skill.load(small_skill)


def test_observer_publishes_rows_and_members(skill: Skill, demonstration_frames: Frames) -> None:
    log = Log()
    session = LiveSession(lambda: Observer(skill, skill.infer), log)
    message = session.answer(frame(demonstration_frames[0], time_s=2.5))
    assert (message["frame"], message["time_s"], message["state"], message["twist"]) == (0, 2.5, "observe", None)
    assert set(message["members"]) == {"p2p_sift", "p2l_sift_lbd"}
    top = skill.infer(demonstration_frames[0]).associations[0]
    own = message["members"]["p2p_sift"]
    assert (own["state"], own["reason"], own["unit"]) == ("approaching", "", "px")
    np.testing.assert_allclose(own["error"], top.error, atol=1e-4)
    assert 0 <= message["sent_at"] - message["taken_at"] < 60
    assert json.loads(encoded(message))["version"] == 1
    assert session.answer(frame(demonstration_frames[1]))["frame"] == 1
    assert len(log.records) == 2


def test_black_picture_has_reasons(skill: Skill) -> None:
    session = LiveSession(lambda: Observer(skill, skill.infer), Log())
    message = session.answer(frame(np.zeros((120, 160, 3), np.uint8)))
    assert message["rows"] == []
    assert message["members"]["p2p_sift"]["state"] == "lost"
    assert message["members"]["p2p_sift"]["reason"]


def test_driver_replies_with_the_command_of_the_servo(skill: Skill, demonstration_frames: Frames) -> None:
    session = LiveSession(lambda: Driver(Servo(skill), 10.0), Log())
    first = session.answer(frame(demonstration_frames[0]))
    second = session.answer(frame(demonstration_frames[1], acted=tuple(first["action"])))
    assert [first["state"], second["state"]] == ["explore", "explore"]
    assert first["dof"] == ["x", "y", "z", "yaw"]
    np.testing.assert_allclose(first["action"], [0.01, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(first["twist"], [0.1, 0, 0, 0, 0, 0], atol=1e-9)
    np.testing.assert_allclose(second["action"], [-0.01, 0, 0, 0], atol=1e-9)
    assert session.answer(Request(Kind.RESTART)) == {"restarted": True}
    third = session.answer(frame(demonstration_frames[2]))
    np.testing.assert_allclose(third["action"], first["action"])  # probing from the beginning


def test_displacements_count_for_the_picture_after_them(demonstration_frames: Frames) -> None:
    watcher, picture = Remembering(), demonstration_frames[0]
    session = LiveSession(lambda: watcher, Log(), "camera 0")
    take = lambda number, time_s: session.take(View([picture], number, time_s, 0.0))  # noqa: E731
    take(0, 0.0)
    for acted, time_s in (([0.1, 0.0], None), ([0.2, 0.5], 0.9), ([0.4, 0.0], 1.1)):
        session.answer(Request(Kind.ACTED, acted=tuple(acted), touched=time_s == 0.9, time_s=time_s))
    take(1, 1.0)
    take(2, 2.0)
    take(3, 3.0)
    assert watcher.told == [(None, False), ([0.3, 0.5], True), ([0.4, 0.0], False), ([0.0, 0.0], False)]


def test_requests_that_do_not_fit_are_refused(skill: Skill, demonstration_frames: Frames) -> None:
    picture, small = demonstration_frames[0], demonstration_frames[0][:60]
    observed = LiveSession(lambda: Observer(skill, skill.infer), Log())
    driven = LiveSession(lambda: Driver(Servo(skill, cameras=2), 10.0), Log())
    remembered = LiveSession(Remembering, Log(), "camera 0")
    observed.answer(frame(picture))
    for session, request, said in (
        (observed, frame(small), r"the picture is 160x60; expected 160x120 \(request: restart\)"),
        (observed, Request(Kind.FRAME, (picture, picture)), "there are 2 pictures; expected 1"),
        (observed, frame(picture, acted=(0.0,)), "acted: nothing is commanded here; expected serve.py drive=true"),
        (driven, frame(picture), "there are 1 pictures; expected 2, one of each camera"),
        (driven, Request(Kind.ACTED, acted=(1.0,)), "acted has 1 numbers; expected 4: x, y, z, yaw"),
        (remembered, frame(picture), "pictures come from camera 0; expected none, or serve.py without video="),
    ):
        with pytest.raises(InputError, match=f"^{said}"):
            session.answer(request)
    observed.answer(Request(Kind.RESTART))
    assert observed.answer(frame(small))["frame"] == 1
    for _ in range(1000):
        remembered.answer(Request(Kind.ACTED, acted=(0.0, 0.0)))
    with pytest.raises(InputError, match="1000 displacements wait for a picture; expected pictures, too"):
        remembered.answer(Request(Kind.ACTED, acted=(0.0, 0.0)))


def test_status(demonstration_frames: Frames) -> None:
    session = LiveSession(Remembering, Log())
    status = session.answer(Request(Kind.STATUS))["status"]
    expected = {"frames": 0, "state": "waiting", "dof": ["x", "yaw"], "source": None, "size": None}
    assert status == {**expected, "latency_s": None}
    session.answer(frame(demonstration_frames[0]))
    status = session.answer(Request(Kind.STATUS))["status"]
    assert (status["frames"], status["state"], status["size"]) == (1, "servo", [160, 120])
    assert status["latency_s"] >= 0


def test_damaged_requests_get_a_reply_or_an_error(demonstration_frames: Frames) -> None:
    chance = random.Random(2)
    session = LiveSession(lambda: Remembering(("x", "y", "z", "yaw")), Log())
    for _ in range(200):
        with contextlib.suppress(InputError):  # anything else is a failure
            encoded(session.answer(parse_request(damaged_request(chance, demonstration_frames[0][:6, :8]))))
    assert session.frames > 10
