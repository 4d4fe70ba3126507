"""Damaged requests to the live interface: each gets a reply, and none makes it command more than it may."""

import json
import random
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import zmq

from geoskill import Servo, Skill
from geoskill.control.action import Limits
from geoskill.exports.live_server import LiveServer
from geoskill.exports.session import Driver, LiveSession
from tests.exports.requests import damaged_request
from tests.exports.test_live_server import free_port

STEP_M, STEP_RAD = 0.004, 0.02


def test_every_damaged_request_gets_a_reply_within_the_limits(
    small_skill: Path, demonstration_frames: Sequence[np.ndarray], rounds: int
) -> None:
    skill, port, chance = Skill.load(small_skill), free_port(), random.Random(4)
    limits = Limits(step_m=STEP_M, step_rad=STEP_RAD)
    session = LiveSession(lambda: Driver(Servo(skill, limits), 10.0), lambda *given: None)
    commands, errors = [], []
    with (
        LiveServer(f"tcp://127.0.0.1:{port}", session.answer),
        zmq.Context() as context,
        context.socket(zmq.REQ) as client,
    ):
        client.setsockopt(zmq.RCVTIMEO, 20_000)
        client.setsockopt(zmq.LINGER, 0)
        client.connect(f"tcp://127.0.0.1:{port + 1}")
        for number in range(5 * rounds):
            client.send_multipart(damaged_request(chance, demonstration_frames[number % 20]))
            reply = json.loads(client.recv())
            assert reply["version"] == 1
            if "error" in reply:
                errors.append(reply["error"])
            if "action" in reply:
                commands.append(reply["action"])
    assert not [said for said in errors if re.match(r"\w+(Error|Exception): ", said)]  # nothing but refusals
    assert rounds // 2 < len(commands) < 5 * rounds - len(errors)
    assert (np.abs(commands) <= np.array([STEP_M, STEP_M, STEP_M, STEP_RAD]) + 1e-6).all()  # rounded to 1e-6
