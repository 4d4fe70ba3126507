"""Recordings as files: what goes in comes out."""

import io
from dataclasses import replace

import numpy as np
import pytest

from geoskill.simulation.recording import Recording, as_png, pack, unpack


def assert_equal(found: Recording, expected: Recording) -> None:
    for name in ("pictures", "shown", "depths"):
        assert getattr(found, name) == getattr(expected, name)
    assert (list(found.bodies), found.roles) == (list(expected.bodies), expected.roles)
    for name in ("poses", "camera"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), strict=True)
    lens, by_hand = found.lens, expected.lens
    assert (lens.width, lens.height, lens.focal_px) == (by_hand.width, by_hand.height, by_hand.focal_px)
    assert (found.cloth is None) == (expected.cloth is None)
    if found.cloth is not None and expected.cloth is not None:
        assert found.cloth.name == expected.cloth.name
        for name in ("rest", "triangles", "vertices"):
            np.testing.assert_array_equal(getattr(found.cloth, name), getattr(expected.cloth, name), strict=True)


@pytest.mark.parametrize("kind", ["hand_made_recording", "folded_cloth"])
def test_packed_stored_and_unpacked_it_is_the_same(kind: str, request: pytest.FixtureRequest) -> None:
    recording: Recording = request.getfixturevalue(kind)
    # Files of several lengths: where one ends the next begins.
    recording = replace(recording, pictures=[recording.pictures[0], recording.pictures[1] + b"more"])
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **pack(recording))
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        assert_equal(unpack(stored), recording)


def test_arrays_of_something_else_do_not_unpack(hand_made_recording: Recording) -> None:
    arrays = pack(hand_made_recording)
    with pytest.raises(KeyError):
        unpack({name: array for name, array in arrays.items() if name != "roles"})
    with pytest.raises(ValueError, match="nobody"):
        unpack(arrays | {"roles": np.array(["nobody"] * 3)})


def test_pixels_by_hand(hand_made_recording: Recording) -> None:
    assert len(hand_made_recording) == 2
    numbers, depth = hand_made_recording.body_ids(0), hand_made_recording.depth_m(0)
    names = [hand_made_recording.bodies[numbers[row, column]] for row, column in ((0, 0), (15, 12), (18, 33), (9, 11))]
    assert names == ["table", "box", "tile", "finger"]
    assert numbers[0, 40] == -2
    np.testing.assert_allclose([depth[0, 0], depth[15, 12], depth[9, 11]], [1.0, 0.8, 0.75])
    picture = hand_made_recording.picture(1)
    assert picture.shape == (31, 41, 3)
    np.testing.assert_allclose(picture, 90, atol=1)


def test_a_cloth_has_number_minus_one(folded_cloth: Recording) -> None:
    numbers = folded_cloth.body_ids(1)
    assert sorted(set(numbers.ravel().tolist())) == [-2, -1]
    assert (numbers == -1).sum() == 81


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_png_loses_nothing(kind: type, hand_made_recording: Recording) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(kind).max, (31, 41), dtype=kind, endpoint=True)
    if kind is np.uint16:
        found = replace(hand_made_recording, depths=[as_png(image)]).depth_m(0)
        np.testing.assert_allclose(found, image * 1e-4, rtol=1e-6)
    else:
        found = replace(hand_made_recording, shown=[as_png(image)]).body_ids(0)
        np.testing.assert_array_equal(found, image.astype(int) - 2)


def test_the_view_of_a_frame(hand_made_recording: Recording) -> None:
    moved = replace(hand_made_recording, camera=np.stack([np.eye(4), 2 * np.eye(4)]))
    view = moved.view(1)
    assert (view.width, view.height, view.focal_px) == (41, 31, 80.0)
    np.testing.assert_array_equal(view.pose, 2 * np.eye(4))
