"""``python serve.py`` and the examples that come with it, each in a process of its own."""

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import zmq

from geoskill.exports.live_server import LiveServer
from tests.exports.test_live_server import free_port

Command = Callable[..., Any]
Frames = tuple[np.ndarray, ...]
ROOT = Path(__file__).resolve().parents[2]


@contextmanager
def served(environment: dict[str, str], *arguments: str) -> "Iterator[tuple[subprocess.Popen[str], int]]":
    """A server that is ready, and the port of its requests."""
    port = free_port()
    command = [sys.executable, "serve.py", f"bind=tcp://127.0.0.1:{port}", *arguments]
    settings: dict[str, Any] = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    # A shell starts what it runs in the background with SIGINT ignored, and a test run would hand that on.
    settings["preexec_fn"] = lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen(command, cwd=ROOT, env=environment, **settings) as process:
        try:
            assert process.stdout is not None
            for line in process.stdout:
                if line.startswith("serving"):
                    break
            yield process, port + 1
        finally:
            process.kill()


@contextmanager
def connected(kind: int, port: int, **options: Any) -> Iterator[Any]:
    with zmq.Context() as context, context.socket(kind) as socket:
        for name, value in {"RCVTIMEO": 30_000, "LINGER": 0, **options}.items():
            socket.setsockopt(getattr(zmq, name), value)
        socket.connect(f"tcp://127.0.0.1:{port}")
        yield socket


def ask(socket: Any, *pictures: bytes, **request: Any) -> dict[str, Any]:
    socket.send_multipart([json.dumps(request).encode(), *pictures])
    reply: dict[str, Any] = json.loads(socket.recv())
    assert reply.pop("version") == 1
    return reply


def jpeg(frame: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", frame[:, :, ::-1])[1].tobytes()


def lines_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


@pytest.mark.slow
def test_client_in_another_process_is_told_how_to_move(
    environment: dict[str, str], skill: Path, demonstration_frames: Frames, tmp_path: Path
) -> None:
    arguments = [f"skill={skill}", "drive=true", "servo.step_mm=4", "threads=1", f"hydra.run.dir={tmp_path}"]
    with served(environment, *arguments) as (process, port):
        with connected(zmq.SUB, port - 1, SUBSCRIBE=b"geoskill") as messages, connected(zmq.REQ, port) as server:
            time.sleep(0.5)
            first = ask(server, jpeg(demonstration_frames[0]), request="frame")
            np.testing.assert_allclose(first["action"], [0.004, 0, 0, 0])
            np.testing.assert_allclose(first["twist"], [0.04, 0, 0, 0, 0, 0])
            assert (first["state"], first["frame"], first["dof"]) == ("explore", 0, ["x", "y", "z", "yaw"])
            published = messages.recv()
            assert published.startswith(b"geoskill {")
            assert {"version": 1, **first} == json.loads(published.partition(b" ")[2])
            # What was found is in the files before anything ends.
            assert {line["frame"] for line in lines_of(tmp_path / "associations.jsonl")} == {0}
            assert not [path for path in tmp_path.iterdir() if ".part" in path.suffixes]
            assert "no JSON" in ask(server, b"x", request=float("nan"))["error"]
            height, width, _ = demonstration_frames[1].shape
            raw = demonstration_frames[1].tobytes()
            assert "accepted" in ask(server, acted=first["action"], time_s=0.0)
            second = ask(server, raw, request="frame", shape=[height, width, 3], touched=False)
            np.testing.assert_allclose(second["action"], [-0.004, 0, 0, 0])
            assert ask(server, request="status")["status"]["frames"] == 2
            assert ask(server, request="stop") == {"stopping": True}
            assert json.loads(messages.recv().partition(b" ")[2])["frame"] == 1
            assert json.loads(messages.recv().partition(b" ")[2]) == {"version": 1, "end": "stopped by a client"}
        out, error = process.communicate(timeout=120)
    assert (process.returncode, error) == (0, "")
    assert "served 2 frames, " in out
    assert out.strip().splitlines()[-1] == str(tmp_path)
    assert [line["state"] for line in lines_of(tmp_path / "servo.jsonl")] == ["explore", "explore"]


@pytest.mark.slow
def test_recording_gives_the_associations_of_infer(
    environment: dict[str, str], command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    source = [f"skill={skill}", f"video={demonstration_folder}", "inference.abstain=0", "threads=2"]
    with served(environment, *source, "realtime=false", f"hydra.run.dir={tmp_path / 'live'}") as (process, _):
        out, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (0, "")
    assert "served 20 frames, " in out
    assert command("infer", *source, f"hydra.run.dir={tmp_path / 'plain'}").status == 0
    files = [(tmp_path / name / "associations.jsonl").read_text(encoding="utf-8") for name in ("live", "plain")]
    assert files[0] == files[1]


@pytest.mark.slow
def test_ctrl_c_ends_it_and_keeps_what_was_written(
    environment: dict[str, str], skill: Path, demonstration_frames: Frames, tmp_path: Path
) -> None:
    with served(environment, f"skill={skill}", f"hydra.run.dir={tmp_path}") as (process, port):
        with connected(zmq.REQ, port) as server:
            reply = ask(server, jpeg(demonstration_frames[0]), request="frame")
            assert (reply["state"], reply["twist"]) == ("observe", None)
            assert "nothing is commanded here" in ask(server, acted=[0, 0, 0, 0])["error"]
        process.send_signal(signal.SIGINT)
        out, error = process.communicate(timeout=120)
    assert (process.returncode, error) == (0, "")
    assert "stopped by Ctrl-C" in out
    assert lines_of(tmp_path / "associations.jsonl")


@pytest.mark.slow
def test_damaged_recording_tells_clients_why_nothing_more_comes(
    environment: dict[str, str], skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    folder, run = tmp_path / "frames", tmp_path / "run"
    shutil.copytree(demonstration_folder, folder)
    (folder / "019.png").write_bytes(b"no picture")
    with served(environment, f"skill={skill}", f"video={folder}", f"hydra.run.dir={run}", "frame_rate=5") as (
        process,
        port,
    ):
        with connected(zmq.SUB, port - 1, SUBSCRIBE=b"geoskill") as messages:
            while "end" not in (message := json.loads(messages.recv().partition(b" ")[2])):
                assert message["state"] == "observe"
        _, error = process.communicate(timeout=120)
    assert message["end"].startswith(f"{folder}/019.png: not a readable image")
    assert (process.returncode, error) == (2, f"error: {message['end']}\n")
    assert lines_of(run / "associations.jsonl")


@pytest.mark.slow
def test_bad_input(command: Command, skill: Path, tmp_path: Path) -> None:
    good = [f"skill={skill}", f"hydra.run.dir={tmp_path}"]
    for given, said in (
        (["bind=ipc:///tmp/x"], "bind=ipc:///tmp/x: expected tcp://HOST:PORT, such as tcp://127.0.0.1:5555"),
        (["cameras=2"], "cameras=2: without drive=true one picture is looked at; expected cameras=1"),
        (["cameras=2", "drive=true", f"video={tmp_path}"], f"{tmp_path}: the folder holds no image"),
        (["video=none.mp4"], "'none.mp4' does not exist; expected a video"),
        (["dof=all"], "dof=all: expected descent, xyzy or xyzabc"),
    ):
        ended = command("serve", *good, *given)
        assert ended.status == 2
        assert ended.stderr.startswith(f"error: {said}"), ended.stderr
        assert ended.stderr.count("\n") == 1
    with LiveServer(f"tcp://127.0.0.1:{(port := free_port())}", lambda request: {}):
        ended = command("serve", *good, f"bind=tcp://127.0.0.1:{port}")
    assert (ended.status, ended.stderr.count("\n")) == (2, 1)
    assert f"port {port}: Address already in use; expected two free ports" in ended.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("opengl")
def test_simulated_robot_is_led_from_another_process(environment: dict[str, str], skill: Path, tmp_path: Path) -> None:
    """With a skill of something else, which loses its way."""
    arguments = [f"skill={skill}", "drive=true", "servo.hold_frames=2", f"hydra.run.dir={tmp_path}"]
    with served(environment, *arguments, "servo.max_frames=16") as (_, port):
        robot = [sys.executable, "notebooks/simulated_robot.py", f"tcp://127.0.0.1:{port}"]
        paths = {"PYTHONPATH": str(ROOT)}
        ended = subprocess.run(
            robot, cwd=ROOT, env={**environment, **paths}, capture_output=True, text=True, timeout=300, check=False
        )
    assert ended.returncode == 0, ended.stderr
    first, last = ended.stdout.splitlines()
    assert first.startswith("begins 110.9 mm and 15.0° from the goal")
    assert last.startswith(("lost ", "done "))
    steps = lines_of(tmp_path / "servo.jsonl")
    assert [step["state"] for step in steps[:8]] == ["explore"] * 8
    assert steps[-1]["state"] in ("lost", "done")


RCLPY = """
import json
class Publisher:
    def publish(self, message):
        own = message.twist
        numbers = [getattr(part, axis) for part in (own.linear, own.angular) for axis in "xyz"]
        print(json.dumps([message.header.frame_id, message.header.stamp, numbers]), flush=True)
class Clock:
    def now(self): return self
    def to_msg(self): return 7
class Node:
    def create_publisher(self, kind, topic, depth): print(kind.__name__, topic, depth, flush=True); return Publisher()
    def get_clock(self): return Clock()
def init(): pass
def ok(): return True
def create_node(name): return Node()
"""
TWIST = """
from types import SimpleNamespace as Part
class TwistStamped:
    def __init__(self):
        self.header, self.twist = Part(stamp=None, frame_id=""), Part(linear=Part(), angular=Part())
"""


@pytest.mark.slow
def test_node_of_ros_2_hands_twists_on(environment: dict[str, str], tmp_path: Path) -> None:
    """ROS is stood in for; the messages are real ones."""
    for name, text in (("rclpy.py", RCLPY), ("geometry_msgs/__init__.py", ""), ("geometry_msgs/msg.py", TWIST)):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    port = free_port()
    source = (ROOT / "notebooks" / "ros2_node.py").read_text(encoding="utf-8").replace(":5555", f":{port}")
    (tmp_path / "node.py").write_text(source, encoding="utf-8")
    assert len([line for line in source.partition("rclpy.init")[2].splitlines() if line]) <= 14
    pipes: dict[str, Any] = {"stdout": subprocess.PIPE, "text": True}
    with (
        LiveServer(f"tcp://127.0.0.1:{port}", lambda request: {}) as server,
        subprocess.Popen([sys.executable, "node.py"], cwd=tmp_path, env=environment, **pipes) as node,
    ):
        assert node.stdout is not None
        assert node.stdout.readline() == "TwistStamped /servo_node/delta_twist_cmds 1\n"
        for _ in range(100):  # until it has connected
            server.publish({"twist": [0.1, 0, 0, 0, 0, 0.2]})
            time.sleep(0.05)
        server.publish({"end": "no more frames"})
        assert node.wait(10) == 0
        commands = set(node.stdout)
    assert commands == {'["base_link", 7, [0.1, 0, 0, 0, 0, 0.2]]\n'}
