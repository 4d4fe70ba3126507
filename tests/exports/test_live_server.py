"""The sockets: what clients do, and do not do, never blocks."""

import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zmq

from geoskill.errors import InputError
from geoskill.exports.live_server import LiveServer, address_of, is_loopback
from geoskill.exports.messages import Kind, Message, Request

Socket = Callable[..., Any]


def free_port() -> int:
    """A port that is free, and the next one, too."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port: int = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
                return port
            except (OSError, OverflowError):
                continue


@pytest.fixture
def port() -> int:
    return free_port()


@pytest.fixture
def client() -> Iterator[Socket]:
    """``client(zmq.REQ, port)`` is a connected socket that waits five seconds at most."""
    context = zmq.Context()
    sockets = []

    def connect(kind: int, port: int, **options: Any) -> Any:
        own = context.socket(kind)
        sockets.append(own)
        own.setsockopt(zmq.RCVTIMEO, 5000)
        own.setsockopt(zmq.LINGER, 0)
        for name, value in options.items():
            own.setsockopt(getattr(zmq, name), value)
        own.connect(f"tcp://127.0.0.1:{port}")
        return own

    yield connect
    for own in sockets:
        own.close(linger=0)
    context.term()


def echo(request: Request) -> Message:
    if request.time_s == 13:
        raise RuntimeError("broken")
    if request.kind is Kind.RESTART:
        raise InputError("cannot\nrestart")
    return {"kind": str(request.kind), "time_s": request.time_s}


def serving(port: int, answer: Callable[[Request], Message] = echo) -> LiveServer:
    return LiveServer(f"tcp://127.0.0.1:{port}", answer)


def test_requests_are_answered_and_none_ends_it(port: int, client: Socket, capsys: pytest.CaptureFixture[str]) -> None:
    with serving(port) as server:
        requests = client(zmq.REQ, port + 1)

        def ask(*parts: bytes) -> dict[str, Any]:
            requests.send_multipart(parts)
            reply: dict[str, Any] = json.loads(requests.recv())
            assert reply.pop("version") == 1
            return reply

        assert ask(b'{"request": "status"}') == {"kind": "status", "time_s": None}
        assert "no JSON" in ask(b"nonsense")["error"]
        assert "no JSON" in ask(b"")["error"]
        assert ask(b'{"request": "restart"}') == {"error": "cannot restart"}
        assert ask(b'{"request": "status", "time_s": 13}') == {"error": "RuntimeError: broken"}
        assert ask(b'{"acted": [1], "time_s": 2}') == {"kind": "acted", "time_s": 2.0}
        assert not server.wait(0)
        assert ask(b'{"request": "stop"}') == {"stopping": True}
        assert server.wait(1)
    assert capsys.readouterr().err == "warning: a request failed: RuntimeError: broken\n"


def test_clients_that_go_or_speak_something_else_do_no_harm(port: int, client: Socket) -> None:
    with serving(port):
        for _ in range(3):
            gone = client(zmq.REQ, port + 1)
            gone.send(b'{"request": "status"}')
            gone.close(linger=0)
        dealer = client(zmq.DEALER, port + 1)
        dealer.send_multipart([b"no delimiter", b"x"])
        for _ in range(2000):  # who never reads the replies
            dealer.send_multipart([b"", b'{"request": "status"}'])
        with socket.create_connection(("127.0.0.1", port + 1)) as raw:
            raw.sendall(b"GET / HTTP/1.1\r\n\r\n" + bytes(range(256)))
        requests = client(zmq.REQ, port + 1)
        requests.send(b'{"request": "status"}')
        assert json.loads(requests.recv())["kind"] == "status"


def test_slow_subscribers_do_not_delay_and_get_the_newest(port: int, client: Socket) -> None:
    with serving(port) as server:
        slow = client(zmq.SUB, port, SUBSCRIBE=b"geoskill", RCVHWM=1, RCVBUF=4096)
        newest = client(zmq.SUB, port, CONFLATE=1, SUBSCRIBE=b"geoskill")
        for _ in range(100):  # until both have connected
            server.publish({"frame": -1})
            time.sleep(0.02)
            if slow.poll(0) and newest.poll(0):
                break
        newest.recv()  # polling has taken one out of the queue
        padding, longest, began = "x" * 20_000, 0.0, time.monotonic()
        for frame in range(1000):
            before = time.monotonic()
            server.publish({"frame": frame, "padding": padding})
            longest = max(longest, time.monotonic() - before)
        assert longest < 0.5
        assert time.monotonic() - began < 5
        time.sleep(0.2)
        server.publish({"frame": 1000})
        time.sleep(0.3)
        assert json.loads(newest.recv().partition(b" ")[2]) == {"version": 1, "frame": 1000}
        assert not newest.poll(0)
        received = 0
        while slow.poll(200):
            slow.recv()
            received += 1
        assert received < 1000  # it has missed some


def test_replies_wait_for_no_publication(port: int, client: Socket) -> None:
    """A request in work keeps others waiting, and no message."""
    begun, released = threading.Event(), threading.Event()

    def slow(request: Request) -> Message:
        begun.set()
        released.wait(5)
        return {}

    with serving(port, slow) as server:
        subscriber = client(zmq.SUB, port, SUBSCRIBE=b"geoskill")
        client(zmq.REQ, port + 1).send(b'{"request": "status"}')
        assert begun.wait(5)
        for frame in range(100):
            server.publish({"frame": frame})
            time.sleep(0.01)
            if subscriber.poll(0):
                break
        assert subscriber.poll(0)
        released.set()


def test_ports_are_released_and_taken_ones_refused(port: int) -> None:
    with serving(port), pytest.raises(InputError, match=rf"bind=tcp://127.0.0.1:{port}: port {port}: .*two free ports"):
        serving(port)
    with serving(port):
        pass
    with (
        socket.socket() as taken,
        pytest.raises(InputError, match=rf"port {port + 1}: Address already in use; expected two free ports"),
    ):
        taken.bind(("127.0.0.1", port + 1))
        taken.listen()
        serving(port)


@pytest.mark.parametrize("given", ["", "5555", "tcp://127.0.0.1", "ipc:///tmp/x", "tcp://127.0.0.1:65535", "tcp://a:0"])
def test_what_is_no_address_is_refused(given: str) -> None:
    with pytest.raises(InputError, match=rf"bind={given}: expected tcp://HOST:PORT"):
        address_of(given)


def test_loopback() -> None:
    assert all(is_loopback(f"tcp://{host}:5555") for host in ("127.0.0.1", "localhost", "[::1]", "127.1"))
    assert not any(
        is_loopback(f"tcp://{host}:5555") for host in ("*", "0.0.0.0", "127.example.org", "10.0.0.1", "[::]")
    )


def test_without_zmq(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "zmq", None)
    with pytest.raises(InputError, match=r"the live interface: needs packages .* pip install 'geoskill\[live\]'"):
        serving(port)
