"""Requests are read or refused in a line; messages are JSON that every reader takes."""

import json
import random
from typing import Any

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.exports.messages import MAX_JSON_BYTES, Kind, encoded, parse_request, published
from tests.exports.requests import damaged_request

PICTURE = np.random.default_rng(0).integers(0, 256, (6, 8, 3), np.uint8)


def header(**keys: Any) -> bytes:
    return json.dumps(keys).encode()


def test_frame_of_a_file() -> None:
    png = cv2.imencode(".png", PICTURE[:, :, ::-1])[1].tobytes()
    request = parse_request([header(version=1, request="frame", acted=[1, 2.5], touched=True, time_s=3), png, png])
    assert (request.kind, request.acted, request.touched, request.time_s) == (Kind.FRAME, (1.0, 2.5), True, 3.0)
    assert len(request.pictures) == 2
    np.testing.assert_array_equal(request.pictures[1], PICTURE)


@pytest.mark.parametrize(("channels", "sent"), [("rgb", PICTURE), ("bgr", PICTURE[:, :, ::-1])])
def test_frame_of_raw_rows(channels: str, sent: np.ndarray) -> None:
    request = parse_request([header(request="frame", shape=[6, 8, 3], channels=channels), sent.tobytes()])
    np.testing.assert_array_equal(request.pictures[0], PICTURE)
    assert (request.acted, request.touched, request.time_s) == (None, False, None)


def test_displacement_needs_no_other_word() -> None:
    request = parse_request([b'{"acted": [0.1, 0, 0, -0.2], "time_s": 0.5}'])
    assert (request.kind, request.acted, request.time_s) == (Kind.ACTED, (0.1, 0.0, 0.0, -0.2), 0.5)


@pytest.mark.parametrize(
    ("parts", "said"),
    [
        ([], "the first part is no JSON"),
        ([b"\xff\xfe"], "the first part is no JSON"),
        ([b"[" * 20_000], "the first part is no JSON"),
        ([b'{"acted": [NaN]}'], "the first part is no JSON (NaN is no number of JSON); expected one"),
        ([b'{"acted": [1e999]}'], "acted is [inf]; expected finite numbers"),
        ([b'{"acted": [' + b"9" * 400 + b"]}"], "acted is [9999"),
        ([b" " * (MAX_JSON_BYTES + 1)], "the first part has 65537 bytes; expected at most 65536 of JSON"),
        ([b"3"], "the first part is 3; expected an object of JSON"),
        ([header(request="frame")], "the request frame has 1 part(s); expected a part for each picture"),
        ([header(request="stop"), b"x"], "the request stop has 2 part(s); expected JSON alone"),
        ([header(request="shutdown")], "request is 'shutdown'; expected frame, acted, status, restart, stop"),
        ([header(request=["stop"])], "request is ['stop']; expected frame, acted, status, restart, stop"),
        ([header()], "request is None; expected frame, acted, status, restart, stop"),
        ([header(request="status", version=2)], "version is 2; expected 1"),
        ([header(request="status", version=True)], "version is True; expected 1"),
        ([header(request="status", _target_="os.system")], "'_target_' is no key of a request; expected version"),
        ([header(request="acted")], "acted is missing; expected the displacement that was carried out"),
        ([header(acted=None)], "acted is missing; expected the displacement that was carried out"),
        ([header(acted=0.1)], "acted is 0.1; expected finite numbers"),
        ([header(acted=[True])], "acted is [True]; expected finite numbers"),
        ([header(acted=[0] * 17)], "acted is [0, 0, 0, 0, 0, 0, ...]; expected finite numbers"),
        ([header(acted=[0], touched=1)], "touched is 1; expected true or false"),
        ([header(acted=[0], time_s="now")], "time_s is ['now']; expected finite numbers"),
        ([header(request="frame"), b"no picture"], "a picture of 10 bytes cannot be read; expected JPEG or PNG"),
        ([header(request="frame"), b""], "a picture of 0 bytes cannot be read; expected JPEG or PNG"),
        ([header(request="frame", shape=[1, 1, 3]), b"1234"], "shape is [1, 1, 3] of 4 bytes; expected [height"),
        ([header(request="frame", shape=[-1, -1, 3]), b"123"], "shape is [-1, -1, 3] of 3 bytes; expected"),
        ([header(request="frame", shape=[3, 1, 1]), b"123"], "shape is [3, 1, 1] of 3 bytes; expected"),
        ([header(request="frame", shape={"a": 1}), b"123"], "shape is {'a': 1} of 3 bytes; expected"),
        ([header(request="frame", channels="hsv"), b"123"], "channels is 'hsv'; expected rgb or bgr"),
    ],
)  # fmt: skip
def test_what_is_no_request_is_refused(parts: list[bytes], said: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_request(parts)
    assert str(refused.value).startswith(said)
    assert len(str(refused.value)) < 300


def test_damaged_requests_are_read_or_refused() -> None:
    chance = random.Random(1)
    outcomes = []
    for _ in range(400):
        try:
            parse_request(damaged_request(chance, PICTURE))
            outcomes.append("")
        except InputError as error:
            outcomes.append(str(error))
    assert max(map(len, outcomes)) < 400
    assert 50 < outcomes.count("") < 350


def test_messages_have_a_version_and_no_nan() -> None:
    message = published({"rows": [{"error": [float("inf")]}], "frame": 2})
    topic, _, text = message.partition(b" ")
    assert topic == b"geoskill"
    assert json.loads(text) == {"version": 1, "rows": [{"error": [None]}], "frame": 2}
    assert encoded({"error": "ä"}) == b'{"version":1,"error":"\\u00e4"}'
