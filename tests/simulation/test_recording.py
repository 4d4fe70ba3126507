"""Recordings: packing, decoding, and ground truth per pixel."""

import io
from dataclasses import replace

import numpy as np
import pytest

from geoskill.simulation.recording import Recording, encode_png, join, pack, unpack


def assert_equal(actual: Recording, expected: Recording) -> None:
    for name in ("pictures", "segmentations", "depths"):
        assert getattr(actual, name) == getattr(expected, name)
    assert (list(actual.bodies), actual.roles) == (list(expected.bodies), expected.roles)
    for name in ("poses", "camera_poses"):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), strict=True)
    for name in ("width", "height", "focal_px"):
        assert getattr(actual.intrinsics, name) == getattr(expected.intrinsics, name)
    assert (actual.cloth is None) == (expected.cloth is None)
    if actual.cloth is not None and expected.cloth is not None:
        assert actual.cloth.name == expected.cloth.name
        for name in ("rest", "triangles", "vertices"):
            np.testing.assert_array_equal(getattr(actual.cloth, name), getattr(expected.cloth, name), strict=True)


@pytest.mark.parametrize("fixture", ["hand_made_recording", "folded_cloth"])
def test_pack_store_and_unpack_give_the_same_recording(fixture: str, request: pytest.FixtureRequest) -> None:
    recording: Recording = request.getfixturevalue(fixture)
    # Files of different lengths test where one ends and the next begins.
    recording = replace(recording, pictures=[recording.pictures[0], recording.pictures[1] + b"more"])
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **pack(recording))
    file.seek(0)
    with np.load(file, allow_pickle=False) as stored:
        assert_equal(unpack(stored), recording)


@pytest.mark.parametrize("fixture", ["hand_made_recording", "folded_cloth"])
def test_join_of_single_frames_is_the_recording(fixture: str, request: pytest.FixtureRequest) -> None:
    recording: Recording = request.getfixturevalue(fixture)
    singles = [
        replace(
            recording,
            pictures=recording.pictures[k : k + 1],
            segmentations=recording.segmentations[k : k + 1],
            depths=recording.depths[k : k + 1],
            poses=recording.poses[k : k + 1],
            camera_poses=recording.camera_poses[k : k + 1],
            cloth=None
            if recording.cloth is None
            else replace(recording.cloth, vertices=recording.cloth.vertices[k : k + 1]),
        )
        for k in range(len(recording))
    ]
    assert_equal(join(singles), recording)
    with pytest.raises(ValueError, match="2 recordings: expected one or more of the same bodies"):
        join([recording, replace(recording, bodies=["other"])])
    with pytest.raises(ValueError, match="0 recordings"):
        join([])


def test_unpack_refuses_missing_arrays_and_unknown_roles(hand_made_recording: Recording) -> None:
    arrays = pack(hand_made_recording)
    with pytest.raises(KeyError):
        unpack({name: array for name, array in arrays.items() if name != "roles"})
    with pytest.raises(ValueError, match="nobody"):
        unpack(arrays | {"roles": np.array(["nobody"] * 3)})


def test_body_ids_depth_and_picture_of_known_pixels(hand_made_recording: Recording) -> None:
    assert len(hand_made_recording) == 2
    body_ids, depth = hand_made_recording.body_ids(0), hand_made_recording.depth_m(0)
    names = [hand_made_recording.bodies[body_ids[row, column]] for row, column in ((0, 0), (15, 12), (18, 33), (9, 11))]
    assert names == ["table", "box", "tile", "finger"]
    assert body_ids[0, 40] == -2
    np.testing.assert_allclose([depth[0, 0], depth[15, 12], depth[9, 11]], [1.0, 0.8, 0.75])
    picture = hand_made_recording.picture(1)
    assert picture.shape == (31, 41, 3)
    np.testing.assert_allclose(picture, 90, atol=1)


def test_cloth_has_body_id_minus_one(folded_cloth: Recording) -> None:
    body_ids = folded_cloth.body_ids(1)
    assert sorted(set(body_ids.ravel().tolist())) == [-2, -1]
    assert (body_ids == -1).sum() == 81


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_png_is_lossless(dtype: type, hand_made_recording: Recording) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (31, 41), dtype=dtype, endpoint=True)
    if dtype is np.uint16:
        actual = replace(hand_made_recording, depths=[encode_png(image)]).depth_m(0)
        np.testing.assert_allclose(actual, image * 1e-4, rtol=1e-6)
    else:
        actual = replace(hand_made_recording, segmentations=[encode_png(image)]).body_ids(0)
        np.testing.assert_array_equal(actual, image.astype(int) - 2)


def test_view_has_the_camera_pose_of_the_frame(hand_made_recording: Recording) -> None:
    moved = replace(hand_made_recording, camera_poses=np.stack([np.eye(4), 2 * np.eye(4)]))
    view = moved.view(1)
    assert (view.width, view.height, view.focal_px) == (41, 31, 80.0)
    np.testing.assert_array_equal(view.pose, 2 * np.eye(4))
