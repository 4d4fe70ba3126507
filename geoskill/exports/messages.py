"""Messages of the live interface: JSON with a version, pictures beside it as bytes, nothing that is executed.

A published message is one part, ``geoskill`` and a space before the JSON, since a socket that keeps only the last
message (CONFLATE) keeps one part. A request has a part of JSON, then one part for each picture: a file of JPEG, PNG or
the like, or raw rows. docs/usage/live.md has every key.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, NoReturn, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError, shown
from geoskill.exports.exporter import finite
from geoskill.io.frames import bgr_to_rgb, quiet_opencv

VERSION: Final = 1
TOPIC: Final = "geoskill"
MAX_JSON_BYTES: Final = 65_536
MAX_PART_BYTES: Final = 64_000_000
"""Bytes of a picture: raw, 21 megapixels."""
MAX_NUMBER: Final = 1e6
MAX_VALUES: Final = 16
KEYS: Final = ("version", "request", "shape", "channels", "acted", "touched", "time_s")

Picture = UInt8[np.ndarray, "height width 3"]
Message = dict[str, Any]


@final
class Kind(StrEnum):
    """What is asked for; the values are the words in requests."""

    FRAME = "frame"
    ACTED = "acted"
    STATUS = "status"
    RESTART = "restart"
    STOP = "stop"


@final
@dataclass(frozen=True, eq=False)
class Request:
    """A request that is well formed.

    Attributes:
        kind: what is asked for.
        pictures: RGB, of a frame; one of each camera.
        acted: displacement that was carried out since the last report; None where it is not told.
        touched: whether the carried thing has come to rest on something.
        time_s: of the frame, or at which the displacement had been carried out, seconds; None where it is not told.
    """

    kind: Kind
    pictures: tuple[Picture, ...] = ()
    acted: tuple[float, ...] | None = None
    touched: bool = False
    time_s: float | None = None


def encoded(message: Mapping[str, Any]) -> bytes:
    """Return a message as JSON with its version; numbers that are none are null.

    >>> encoded({"frame": 1, "error": [0.5, float("nan")]})
    b'{"version":1,"frame":1,"error":[0.5,null]}'
    """
    whole = finite({"version": VERSION, **message})
    return json.dumps(whole, allow_nan=False, separators=(",", ":")).encode()


def published(message: Mapping[str, Any]) -> bytes:
    """Return a message as it is published: after the topic and a space."""
    return TOPIC.encode() + b" " + encoded(message)


def parse_request(parts: Sequence[bytes]) -> Request:
    """Return a request from its parts.

    Args:
        parts: JSON, then the pictures of a frame.

    Raises:
        InputError: when it is no request of this version; whatever its bytes are, nothing else is raised.
    """
    header = _header(parts[0] if parts else b"")
    given = header.get("request", Kind.ACTED if "acted" in header and len(parts) == 1 else None)
    if not isinstance(given, str) or given not in set(Kind):
        raise InputError(f"request is {shown(given)}; expected {', '.join(Kind)}")
    kind = Kind(given)
    if (len(parts) > 1) != (kind is Kind.FRAME):
        wanted = "a part for each picture" if kind is Kind.FRAME else "JSON alone"
        raise InputError(f"the request {kind} has {len(parts)} part(s); expected {wanted}")
    if kind is Kind.ACTED and header.get("acted") is None:
        raise InputError("acted is missing; expected the displacement that was carried out")
    touched, time_s = header.get("touched", False), header.get("time_s")
    if not isinstance(touched, bool):
        raise InputError(f"touched is {shown(touched)}; expected true or false")
    return Request(
        kind,
        tuple(_picture(part, header) for part in parts[1:]),
        None if header.get("acted") is None else _numbers("acted", header["acted"]),
        touched,
        None if time_s is None else _numbers("time_s", [time_s])[0],
    )


def _header(data: bytes) -> dict[str, Any]:
    if len(data) > MAX_JSON_BYTES:
        raise InputError(f"the first part has {len(data)} bytes; expected at most {MAX_JSON_BYTES} of JSON")

    def refuse(name: str) -> NoReturn:
        raise ValueError(f"{name} is no number of JSON")

    try:
        header = json.loads(data.decode("utf-8"), parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"the first part is no JSON ({' '.join(str(error).split())[:100]}); expected one") from error
    if not isinstance(header, dict):
        raise InputError(f"the first part is {shown(header)}; expected an object of JSON")
    version = header.get("version", VERSION)
    if isinstance(version, bool) or version != VERSION:
        raise InputError(f"version is {shown(version)}; expected {VERSION}")
    unknown = next((key for key in header if key not in KEYS), None)
    if unknown is not None:
        raise InputError(f"{shown(unknown)} is no key of a request; expected {', '.join(KEYS)}")
    return header


def _numbers(key: str, values: Any) -> tuple[float, ...]:
    if not isinstance(values, list) or len(values) > MAX_VALUES or not all(map(_is_number, values)):
        raise InputError(f"{key} is {shown(values)}; expected finite numbers")
    return tuple(map(float, values))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and -MAX_NUMBER <= value <= MAX_NUMBER


def _picture(data: bytes, header: Mapping[str, Any]) -> Picture:
    """Return a picture from its bytes: raw where the header gives a shape, else a file of any usual kind."""
    channels = header.get("channels", "rgb")
    if channels not in ("rgb", "bgr"):
        raise InputError(f"channels is {shown(channels)}; expected rgb or bgr")
    if "shape" in header:
        return _raw(data, header["shape"], str(channels))
    buffer = np.frombuffer(data, np.uint8)
    try:
        with quiet_opencv():
            image = cv2.imdecode(buffer, cv2.IMREAD_COLOR) if buffer.size else None
    except (cv2.error, MemoryError):
        image = None
    if image is None or image.ndim != 3 or image.size == 0:
        raise InputError(f"a picture of {len(data)} bytes cannot be read; expected JPEG or PNG, or shape for raw rows")
    return bgr_to_rgb(image)


def _raw(data: bytes, shape: Any, channels: str) -> Picture:
    sizes = shape if isinstance(shape, list) and len(shape) == 3 else [0]
    whole = all(isinstance(size, int) and not isinstance(size, bool) and 0 < size <= MAX_PART_BYTES for size in sizes)
    if not whole or sizes[2] != 3 or math.prod(sizes) != len(data):
        raise InputError(f"shape is {shown(shape)} of {len(data)} bytes; expected [height, width, 3] of uint8")
    image = np.frombuffer(data, np.uint8).reshape(sizes)
    return np.ascontiguousarray(image if channels == "rgb" else image[:, :, ::-1])
