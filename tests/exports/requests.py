"""Requests that are damaged at random, for the fuzz tests here and of tests/robustness."""

import json
import random
from typing import Any

import cv2
import numpy as np

VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 3, 10**9, 2**300, 1.5, -1e308, "x", "frame", "x" * 5000, [], [[]], {}, [0, 0, 0, 0], [1e5] * 4,
    {"a": 1}, [2, 2, 3], [6, 8, 3],
)  # fmt: skip
KEYS = ("version", "request", "shape", "channels", "acted", "touched", "time_s", "_target_", "")
KINDS = ("frame", "frame", "frame", "acted", "status", "restart")


def damaged_request(chance: random.Random, picture: np.ndarray) -> list[bytes]:
    """Return the parts of a request of which some are damaged: keys, values, bytes, or their number."""
    header: dict[str, Any] = {"request": chance.choice(KINDS), "acted": [0.001, 0.0, 0.0, 0.01], "touched": False}
    parts: list[bytes] = []
    if header["request"] == "frame":
        if chance.random() < 0.5:
            header["shape"] = list(picture.shape)
            parts.append(picture.tobytes())
        else:
            parts.append(cv2.imencode(chance.choice((".png", ".jpg")), picture)[1].tobytes())
    for _ in range(chance.choice((0, 0, 1, 1, 2))):
        header[chance.choice(KEYS)] = chance.choice(VALUES)
    parts = [json.dumps(header).encode(), *parts]
    for _ in range(chance.choice((0, 0, 0, 1))):
        place = chance.choice((0, len(parts) - 1))
        parts[place] = damaged(parts[place], chance)
    if chance.random() < 0.1:
        parts.insert(chance.randrange(len(parts) + 1), chance.randbytes(chance.choice((0, 1, 100))))
    return parts


def damaged(content: bytes, chance: random.Random) -> bytes:
    """Flip, cut, repeat or overwrite some bytes."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 4))):
        if not changed:
            break
        place, length = chance.randrange(len(changed)), chance.choice((1, 4, 64))
        kind = chance.randrange(4)
        if kind == 0:
            changed[place] ^= 1 << chance.randrange(8)
        elif kind == 1:
            del changed[place:]
        elif kind == 2:
            changed[place:place] = changed[place : place + length]
        else:
            changed[place : place + length] = chance.choice((b"\x00", b"\xff", b"[", b'"')) * length
    return bytes(changed)
