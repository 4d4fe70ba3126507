"""A simulated robot that ``python serve.py skill=RUN drive=true`` leads from another process.

It sends what its camera sees and what it did, and does what it is told: exchange ``SimulatedRobot`` for your own. The
skill is one of the simulated insertion: ``python train.py kernel=p2p_l2l task=insertion``.
"""

import json
import os
import sys
from typing import Any

os.environ.setdefault("MUJOCO_GL", "egl")  # before MuJoCo is imported

import cv2
import numpy as np
import zmq

from geoskill.config import ScenarioConfig
from geoskill.control.points_plant import carried_out
from geoskill.geometry.poses import pose, rotation_about, rotation_vector
from geoskill.plugins import TASKS
from geoskill.simulation.stage import Stage

STEP_S, TOUCH_M = 0.1, 1e-4
AXES = [0, 1, 2, 5]
"""x, y, z and the turn about the vertical, of a twist."""


class SimulatedRobot:
    """Holds the thing, some centimeters away from where it belongs; the place it belongs to stops it from below."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._body = stage.bodies().index(stage.roles[0].body)
        goal = stage.scene.goal
        turn = rotation_about(np.array([0.0, 0.0, np.radians(15)]))
        stage.put(pose(goal[:3, 3] + (0.07, -0.05, 0.07), turn @ goal[:3, :3]))

    @property
    def _pose(self) -> np.ndarray:
        return np.asarray(self._stage.poses()[self._body])

    @property
    def _grip(self) -> np.ndarray:
        return np.asarray((self._pose @ self._stage.scene.grip.pose)[:3, 3])

    def picture(self) -> bytes:
        """Return what the camera sees, as a JPEG."""
        return cv2.imencode(".jpg", self._stage.picture()[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()

    def move(self, action: list[float]) -> tuple[list[float], bool]:
        """Carry out a displacement about the grip; return what became of it, and whether the thing rests."""
        before, grip = self._pose, self._grip
        twist = np.zeros(6)
        twist[AXES] = action
        target, _ = carried_out(before, grip, twist)
        floor = self._stage.scene.goal[2, 3]
        target[2, 3] = max(target[2, 3], floor)
        self._stage.lead(target, seconds=STEP_S)
        turn = rotation_vector(self._pose[:3, :3] @ before[:3, :3].T)
        acted = np.concatenate([self._grip - grip, turn])[AXES]
        return acted.tolist(), bool(self._pose[2, 3] < floor + TOUCH_M)

    def distance(self) -> tuple[float, float]:
        """Return how far the thing is from where it belongs, in millimeters and degrees."""
        own = self._stage.distance_to_goal()
        return own.mm, own.deg


def main(address: str = "tcp://127.0.0.1:5556") -> None:
    """Ask at the address what to do, until it is done or lost."""
    server = zmq.Context().socket(zmq.REQ)
    server.setsockopt(zmq.RCVTIMEO, 60_000)
    server.connect(address)

    def ask(*parts: bytes, **header: Any) -> dict[str, Any]:
        server.send_multipart([json.dumps(header).encode(), *parts])
        reply: dict[str, Any] = json.loads(server.recv())
        if "error" in reply:
            sys.exit(f"refused: {reply['error']}")
        return reply

    with Stage(TASKS.build("insertion", {})(), ScenarioConfig(actor="robot"), 0, "live") as stage:
        robot = SimulatedRobot(stage)
        print("begins {:.1f} mm and {:.1f}° from the goal".format(*robot.distance()))
        acted, touched, frames = None, False, 0
        while True:
            reply = ask(robot.picture(), request="frame", acted=acted, touched=touched)
            frames += 1
            if reply["state"] in ("done", "lost"):
                break
            acted, touched = robot.move(reply["action"])
        print(
            f"{reply['state']} {reply['reason']} after {frames} frames: {{:.2f}} mm, {{:.2f}}°".format(
                *robot.distance()
            )
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
