"""Sockets of the live interface: messages are published, and requests are answered in a thread.

Nothing that a client does blocks: for a subscriber that does not keep up, or is gone, messages are dropped; a reply to
a client that is gone is, too. A request that cannot be used is answered with an error. Clients are sockets of REQ; the
socket here is a ROUTER, for a REP loses a reply after somebody has sent what is no request and has gone (libzmq 4.3.5).
"""

import re
import sys
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Final, final

from geoskill.errors import InputError, missing_extra
from geoskill.exports.messages import MAX_PART_BYTES, Kind, Message, Request, encoded, parse_request, published

ADDRESS: Final = re.compile(r"tcp://(\*|\[[0-9a-fA-F:.]+\]|[A-Za-z0-9_.-]+):([0-9]{1,5})")
LOOPBACK: Final = re.compile(r"127\.[0-9.]+|localhost|\[::1\]")
POLL_MS: Final = 100
LINGER_MS: Final = 200
"""How long what has been sent may take to leave at the end."""
QUEUED: Final = 4
"""Messages kept for a subscriber that does not keep up."""
SEND_BUFFER_BYTES: Final = 65_536
"""Of the system, for each subscriber: small, so that what is kept there is not old."""

Answer = Callable[[Request], Message]


@final
class LiveServer:
    """Publishes messages at an address, and answers requests at the next port; a context.

    Args:
        bind: address, ``tcp://HOST:PORT``.
        answer: called in the thread of requests, one after the other; a request to stop is answered here.

    Attributes:
        stopping: set when a client has asked to stop, or by :meth:`close`.

    Raises:
        InputError: when it is no such address, it is taken, or ZeroMQ is not installed.
    """

    def __init__(self, bind: str, answer: Answer) -> None:
        try:
            import zmq
        except ImportError:
            raise missing_extra("the live interface", "live") from None
        self._zmq: Any = zmq
        host, port = address_of(bind)
        self._answer = answer
        self._publishing = threading.Lock()
        self.stopping = threading.Event()
        self._failure: Exception | None = None
        self._context = zmq.Context()
        self._publisher, self._requests = self._context.socket(zmq.PUB), self._context.socket(zmq.ROUTER)
        self._publisher.setsockopt(zmq.SNDHWM, QUEUED)
        self._publisher.setsockopt(zmq.SNDBUF, SEND_BUFFER_BYTES)
        self._requests.setsockopt(zmq.MAXMSGSIZE, MAX_PART_BYTES)
        for socket, own in ((self._publisher, port), (self._requests, port + 1)):
            socket.setsockopt(zmq.IPV6, host.startswith("["))
            try:
                socket.bind(f"tcp://{host}:{own}")
            except zmq.ZMQError as error:
                self._release()
                raise InputError(
                    f"bind={bind}: port {own}: {zmq.strerror(error.errno or 0)}; expected two free ports"
                ) from error
        self._thread = threading.Thread(target=self._serve, name="requests", daemon=True)

    def __enter__(self) -> "LiveServer":
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def publish(self, message: Message) -> None:
        """Publish a message; whoever does not keep up does not get it."""
        with self._publishing:
            self._publisher.send(published(message), self._zmq.NOBLOCK)

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until it is to stop, at most so long, and return whether it is.

        Raises:
            RuntimeError: when the thread of requests has failed.
        """
        stopping = self.stopping.wait(seconds)
        if self._failure is not None:
            raise RuntimeError("requests are no longer answered") from self._failure
        return stopping

    def close(self) -> None:
        """Answer the request in work, if there is one, and release the ports."""
        self.stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        self._release()

    def _release(self) -> None:
        for socket in (self._publisher, self._requests):
            socket.close(linger=LINGER_MS)
        self._context.term()

    def _serve(self) -> None:
        try:
            while not self.stopping.is_set():
                if not self._requests.poll(POLL_MS):
                    continue
                client, *parts = self._requests.recv_multipart()
                if parts and parts[0] == b"":  # the delimiter of a request; from who sends none, nothing is wanted
                    self._requests.send_multipart([client, b"", encoded(self._reply(parts[1:]))], self._zmq.NOBLOCK)
        except Exception as error:
            self._failure = error
            self.stopping.set()

    def _reply(self, parts: Sequence[bytes]) -> Message:
        try:
            request = parse_request(parts)
            if request.kind is Kind.STOP:
                self.stopping.set()
                return {"stopping": True}
            return self._answer(request)
        except InputError as error:
            return {"error": " ".join(str(error).split())}
        except Exception as error:
            message = f"{type(error).__name__}: {' '.join(str(error).split())[:500]}"
            print(f"warning: a request failed: {message}", file=sys.stderr)
            return {"error": message}


def address_of(bind: str) -> tuple[str, int]:
    """Return host and port of an address.

    >>> address_of("tcp://127.0.0.1:5555")
    ('127.0.0.1', 5555)

    Raises:
        InputError: when it is none, or there is no next port.
    """
    match = ADDRESS.fullmatch(bind)
    port = 0 if match is None else int(match[2])
    if match is None or not 0 < port < 65_535:
        raise InputError(f"bind={bind}: expected tcp://HOST:PORT, such as tcp://127.0.0.1:5555, and a port below 65535")
    return match[1], port


def is_loopback(bind: str) -> bool:
    """Return whether only this computer can reach an address."""
    return LOOPBACK.fullmatch(address_of(bind)[0]) is not None
