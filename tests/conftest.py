"""What all tests share."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import jaxtyping
import numpy as np
import pytest
import torch

import geoskill.simulation  # noqa: F401  # before anything imports MuJoCo, which then decides how it renders
from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance, skill_entry, write_checkpoint
from geoskill.skill.plan import plan_skill
from geoskill.skill.spec import SkillSpec

if TYPE_CHECKING:
    from geoskill.simulation.recording import Recording

pytest_plugins = ["tests.training_runs", "tests.command_runs"]

# The demonstrations are no part of this repository; they lie in a folder beside it.
BLOCKS = Path(__file__).resolve().parents[2] / "shared" / "data" / "blocks"


@pytest.fixture(scope="session")
def blocks() -> Path:
    """The folder of the real demonstration: human1/, robot1/ and their regions."""
    if not BLOCKS.is_dir():
        pytest.skip(f"the real demonstrations are not there; expected the folder {BLOCKS}")
    return BLOCKS


@pytest.fixture(scope="session")
def demonstration_frames() -> tuple[np.ndarray, ...]:
    """20 RGB frames of 120 rows x 160 columns: a patterned tile slides 2.5 pixels a frame to the right, up to another.

    The moving tile covers x 28 to 60, y 46 to 78 in the first frame, x 75.5 to 107.5 in the last; the resting tile
    x 108 to 140 throughout. Below both, a third tile that has nothing to do with it rests at x 60 to 92, y 88 to 120.
    """
    generator = np.random.default_rng(3)
    moving, target, bystander = (
        np.kron(generator.integers(30, 226, (4, 4, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(3)
    )
    background = np.full((120, 160, 3), 128, np.uint8)
    background[46:78, 108:140] = target
    background[88:120, 60:92] = bystander
    frames = []
    for number in range(20):
        frame = background.copy()
        shift = np.array([[1, 0, 28 + 2.5 * number], [0, 1, 46]], np.float32)
        cv2.warpAffine(moving, shift, (160, 120), dst=frame, borderMode=cv2.BORDER_TRANSPARENT)
        frames.append(frame)
    return tuple(frames)


@pytest.fixture(scope="session")
def demonstration_folder(
    tmp_path_factory: pytest.TempPathFactory, demonstration_frames: tuple[np.ndarray, ...]
) -> Path:
    """The same as a folder of PNG files; read only."""
    folder = tmp_path_factory.mktemp("demonstration")
    for number, frame in enumerate(demonstration_frames):
        cv2.imwrite(str(folder / f"{number:03d}.png"), frame[:, :, ::-1])
    return folder


@pytest.fixture
def annotations_unchecked(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a user can pass by mistake must reach our own check also when the tests check annotations."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)


@pytest.fixture(scope="session")
def small_model() -> dict[str, Any]:
    """Return the default network, but of 8 hidden units and 2 steps, as ``model=`` of a configuration."""
    return {"name": "message_passing", "hidden_dim": 8, "layers": 2}


@pytest.fixture(scope="session")
def spec(small_model: dict[str, Any]) -> SkillSpec:
    """Return a skill of two members, p2p_sift and p2l_sift_lbd, with 10 features of a type and a top_k of 4."""
    features = FeaturesConfig(max_features=10, min_side=0, color=0.0)
    return plan_skill(["p2p", "p2l"], ["sift", "lbd"], small_model, features, top_k=4)


@pytest.fixture(scope="session")
def small_skill(spec: SkillSpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained skill of two members that says it is finished."""
    members = build_skill(spec, seed=3).members
    for member in members.values():
        member.set_reward_scale(torch.tensor([2, 4]), torch.tensor([0.5, 0.25]))
        member.set_reference_margin(torch.tensor(1.0))
    provenance = Provenance(("tiles.mp4",), (160, 120), "2026-02-03", "1", 7, finished=True, epochs=(2, 2))
    weights = {f"members.{name}.{key}": w for name, m in members.items() for key, w in m.state_dict().items()}
    path: Path = tmp_path_factory.mktemp("skill") / "skill.ckpt"
    write_checkpoint(path, {"skill": skill_entry(spec, provenance, {}), "state_dict": weights})
    return path


@pytest.fixture(scope="session")
def opengl() -> None:
    """For what renders: passes by where no OpenGL context can be had, but not where tests are run automatically."""
    import mujoco

    from geoskill.simulation.renderer import Renderer, add_camera

    spec = mujoco.MjSpec()
    add_camera(spec, 64, 48)
    try:
        Renderer(spec.compile(), 64, 48).close()
    except InputError as error:
        if "CI" in os.environ:
            raise
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def hand_made_recording() -> "Recording":
    """Two frames seen from 1 m above the table, where a pixel is 1.25 cm wide on the table and 1 cm on top of the box.

    Row 15, column 20 is above the world's origin; x is to the right and y is up in the image. Column 40 shows no body.

    - tile (the target), at x = 0.125 on the table: columns 27 to 33, rows 12 to 18.
    - box (the object), 0.2 m high, with its frame on its top: first at x = -0.08, columns 10 to 14, rows 13 to 17; at
      the goal at x = 0.1, after a quarter turn counterclockwise, columns 28 to 32 of the same rows.
    - finger (of the agent), 0.25 m high: first columns 11 to 13, rows 9 to 12, just above the box in the image; at the
      goal in the bottom right corner of the image, columns 38 to 40, rows 28 to 30.
    """
    from geoskill.geometry.camera import PinholeCamera
    from geoskill.geometry.poses import pose, rotation_about
    from geoskill.simulation.recording import Recording, encode_png
    from geoskill.simulation.roles import SceneRole
    from geoskill.simulation.tasks.task import RolePart

    bodies = ["world", "table", "box", "tile", "finger"]
    above = pose((0.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0]))
    segmentations, depths = [], []
    for box, finger in (
        (np.s_[13:18, 10:15], np.s_[9:13, 11:14]),
        (np.s_[13:18, 28:33], np.s_[28:31, 38:41]),
    ):
        segmentation, depth = np.full((31, 41), 1, np.uint8), np.full((31, 41), 10000, np.uint16)
        segmentation[:, 40], depth[:, 40] = 0, 65535
        for name, area, distance in (
            ("tile", np.s_[12:19, 27:34], 10000),
            ("box", box, 8000),
            ("finger", finger, 7500),
        ):
            segmentation[area], depth[area] = bodies.index(name) + 2, distance
        segmentation[segmentation == 1] = bodies.index("table") + 2
        segmentations.append(encode_png(segmentation))
        depths.append(encode_png(depth))
    still = [pose((0.0, 0.0, 0.0)), pose((0.0, 0.0, 0.0)), pose((0.125, 0.0, 0.0))]
    turned = pose((0.1, 0.0, 0.2), rotation_about(np.array([0.0, 0.0, np.pi / 2])))
    poses = [
        [still[0], still[1], box_pose, still[2], pose((0.0, 0.0, 0.25))]
        for box_pose in (pose((-0.08, 0.0, 0.2)), turned)
    ]
    picture = cv2.imencode(".jpg", np.full((31, 41, 3), 90, np.uint8))[1].tobytes()
    return Recording(
        pictures=[picture] * 2,
        segmentations=segmentations,
        depths=depths,
        bodies=bodies,
        poses=np.array(poses),
        intrinsics=PinholeCamera(41, 31, 80.0, np.eye(4)),
        camera_poses=np.stack([above, above]),
        roles=(
            RolePart("box", SceneRole.OBJECT),
            RolePart("tile", SceneRole.TARGET),
            RolePart("finger", SceneRole.AGENT),
        ),
    )


@pytest.fixture(scope="session")
def folded_cloth(hand_made_recording: "Recording") -> "Recording":
    """Two frames of the same camera above a square cloth of 10 cm, first flat, with its near left corner at the origin.

    It consists of two triangles, on both sides of the diagonal from the near left to the far right corner. At the goal
    the far left corner is 4 cm above the near right one, so that the far triangle covers the near one.
    The object is the part that is farther than 5 cm from the near edge, the target the rest.
    """
    from dataclasses import replace

    from geoskill.simulation.recording import Cloth, encode_png
    from geoskill.simulation.roles import SceneRole
    from geoskill.simulation.tasks.task import INFINITE, RolePart

    rest = np.array([[0.0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]])
    folded = rest.copy()
    folded[3] = [0.1, 0.0, 0.04]
    segmentation = np.zeros((31, 41), np.uint8)
    segmentation[7:16, 20:29] = 1
    flat = np.full((31, 41), 10000, np.uint16)
    folded_depth = flat.copy()
    folded_depth[13, 26] = 9804  # the ray meets the upper layer at 0.98039
    return replace(
        hand_made_recording,
        segmentations=[encode_png(segmentation)] * 2,
        depths=[encode_png(flat), encode_png(folded_depth)],
        bodies=["world", "cloth"],
        poses=np.tile(np.eye(4), (2, 2, 1, 1)),
        roles=(
            RolePart("cloth", SceneRole.OBJECT, lower=(-INFINITE, 0.05, -INFINITE)),
            RolePart("cloth", SceneRole.TARGET),
        ),
        cloth=Cloth("cloth", rest, np.array([[0, 1, 2], [0, 2, 3]]), np.stack([rest, folded])),
    )
