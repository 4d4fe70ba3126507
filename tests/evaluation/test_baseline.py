"""Tests of the hand-picked baseline on images whose every pixel is known."""

import cv2
import numpy as np

from geoskill.evaluation.baseline import PAIRS, track_hand_picked_pairs
from geoskill.geometry.camera import PinholeCamera
from geoskill.geometry.poses import pose
from geoskill.simulation.recording import Recording, encode_png
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import RolePart

# Seen from 1 m above, a pixel is a millimeter wide. The box slides 4 px a frame toward the tile, which is at rest.
WIDTH, HEIGHT, FOCAL = 241, 121, 1000.0
SIDE, ROW, STEP, FRAMES = 48, 36, 4, 20
BODIES = ["world", "box", "tile"]


def print_of(seed: int) -> np.ndarray:
    generator = np.random.default_rng(seed)
    return np.kron(generator.integers(20, 236, (8, 8, 3)), np.ones((SIDE // 8, SIDE // 8, 1))).astype(np.uint8)


def recording(prints: tuple[np.ndarray, np.ndarray], blank: int | None = None, jump: int = 0) -> Recording:
    """Return a recording with a blank frame, if any, and a jump of the box after the tenth frame."""
    pictures, shown, poses = [], [], []
    for frame in range(FRAMES):
        image, number = np.full((HEIGHT, WIDTH, 3), 128, np.uint8), np.full((HEIGHT, WIDTH), 2, np.uint8)
        matrices = [np.eye(4)]
        box_column = 10 + STEP * frame + (jump if frame > 10 else 0)
        for body, column, texture in ((1, box_column, prints[0]), (2, 180, prints[1])):
            where = np.s_[ROW : ROW + SIDE, column : column + SIDE]
            image[where], number[where] = texture, body + 2
            matrices.append(pose(((column - (WIDTH - 1) / 2) / FOCAL, 0.0, 0.0)))
        if frame == blank:
            image[:] = 128
        pictures.append(cv2.imencode(".png", image[..., ::-1])[1].tobytes())
        shown.append(encode_png(number))
        poses.append(matrices)
    above = pose((0.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0]))
    return Recording(
        pictures=pictures,
        segmentations=shown,
        depths=[encode_png(np.full((HEIGHT, WIDTH), 10000, np.uint16))] * FRAMES,
        bodies=BODIES,
        poses=np.array(poses),
        intrinsics=PinholeCamera(WIDTH, HEIGHT, FOCAL, np.eye(4)),
        camera_poses=np.repeat(above[None], FRAMES, axis=0),
        roles=(RolePart("box", SceneRole.OBJECT), RolePart("tile", SceneRole.TARGET)),
    )


def test_baseline_keeps_visible_pairs() -> None:
    outcome = track_hand_picked_pairs(recording((print_of(0), print_of(1))))
    assert outcome.picked == PAIRS
    assert outcome.kept >= PAIRS - 2
    assert outcome.success


def test_baseline_lost_trackers_stay_lost() -> None:
    outcome = track_hand_picked_pairs(recording((print_of(0), print_of(1)), blank=8))
    assert (outcome.picked, outcome.kept, outcome.success) == (PAIRS, 0, False)


def test_baseline_drops_trackers_that_end_elsewhere() -> None:
    # The box jumps by half of its side: whatever is found there is not what was picked.
    outcome = track_hand_picked_pairs(recording((print_of(0), print_of(1)), jump=40))
    assert (outcome.picked, outcome.kept, outcome.success) == (PAIRS, 0, False)


def test_baseline_without_corners() -> None:
    plain = np.full((SIDE, SIDE, 3), 128, np.uint8)
    outcome = track_hand_picked_pairs(recording((plain, print_of(1))))
    assert (outcome.picked, outcome.kept, outcome.success) == (0, 0, False)
