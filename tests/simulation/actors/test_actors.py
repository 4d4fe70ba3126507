"""Contract of the actors: they close on the object, and all their bodies have names."""

import mujoco
import numpy as np
import pytest

from geoskill.geometry.poses import pose, rotation_about
from geoskill.simulation.actors.actor import BODY, Actor, Grip
from geoskill.simulation.actors.gripper import OPENING_M, Gripper
from geoskill.simulation.actors.hand import Hand
from geoskill.simulation.shapes import set_body_pose

ACTORS = [Hand(), Gripper()]
GRIP = Grip(np.eye(4), 0.03)


def model_of(actor: Actor, grip: Grip = GRIP, seed: int = 0) -> mujoco.MjModel:
    spec = mujoco.MjSpec()
    actor.add(spec, grip, np.random.default_rng(seed))
    return spec.compile()


def finger_positions(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, np.ndarray]:
    """Return the mean position of the shapes of each finger."""
    mujoco.mj_forward(model, data)
    fingers = [model.body(model.jnt_bodyid[joint]) for joint in range(model.njnt)]
    return {
        finger.name: np.mean([data.geom_xpos[finger.geomadr[0] + k] for k in range(finger.geomnum[0])], axis=0)
        for finger in fingers
    }


@pytest.mark.parametrize("actor", ACTORS, ids=lambda actor: type(actor).__name__)
def test_fingers_open_along_x_on_both_sides(actor: Actor) -> None:
    model = model_of(actor)
    data = mujoco.MjData(model)
    actor.set_opening(model, data, 0.0)
    closed = finger_positions(model, data)
    actor.set_opening(model, data, 1.0)
    opened = finger_positions(model, data)
    sides = {name: np.sign(position[0]) for name, position in closed.items()}
    assert set(sides.values()) == {-1.0, 1.0}
    for name, side in sides.items():
        assert side * (opened[name][0] - closed[name][0]) > 0.01
    actor.set_opening(model, data, 0.0)
    for name, position in finger_positions(model, data).items():
        np.testing.assert_allclose(position, closed[name])


def test_gripper_fingers_touch_the_object_and_open_by_a_known_distance() -> None:
    actor = Gripper()
    model = model_of(actor)
    data = mujoco.MjData(model)
    for opening in (0.0, 0.5, 1.0):
        actor.set_opening(model, data, opening)
        mujoco.mj_forward(model, data)
        for name, side in (("left_finger", -1), ("right_finger", 1)):
            first = model.body(name).geomadr[0]
            inner = side * data.geom_xpos[first, 0] - model.geom_size[first, 0]
            assert inner == pytest.approx(GRIP.half_width_m + opening * OPENING_M)


@pytest.mark.parametrize("actor", ACTORS, ids=lambda actor: type(actor).__name__)
def test_actor_moves_as_one_body(actor: Actor) -> None:
    model = model_of(actor)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    before = data.geom_xpos.copy()
    actor_pose = pose((0.1, -0.2, 0.3), rotation_about(np.array([0.2, 0.4, -1.0])))
    set_body_pose(model, data, BODY, actor_pose)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.geom_xpos, before @ actor_pose[:3, :3].T + actor_pose[:3, 3], atol=1e-9)
    # Roles refer to names: a body without one could not be told from the world.
    assert all(model.body(body_id).name for body_id in range(1, model.nbody))
    assert all(model.body(body_id).rootid[0] == model.body(BODY).id for body_id in range(1, model.nbody))


@pytest.mark.parametrize("actor", ACTORS, ids=lambda actor: type(actor).__name__)
def test_arm_comes_from_behind_and_above(actor: Actor) -> None:
    model = model_of(actor)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    farthest = data.geom_xpos[np.linalg.norm(data.geom_xpos, axis=1).argmax()]
    assert farthest[1] > 0.15
    assert farthest[2] > 0.05


def test_hand_and_gripper_differ_in_appearance() -> None:
    """The hand has the textures of skin and sleeve, the gripper none; the colors depend on the seed."""
    hand, gripper = model_of(Hand()), model_of(Gripper())
    assert {hand.mat(index).name for index in range(hand.nmat)} == {"skin", "sleeve"}
    assert gripper.nmat == 0
    assert np.any(model_of(Hand(), seed=1).tex_data != hand.tex_data)
    assert np.any(model_of(Gripper(), seed=1).geom_rgba != gripper.geom_rgba)
    skin = hand.tex_data[: hand.tex_adr[1]].reshape(-1, 3).mean(axis=0) if hand.ntex > 1 else hand.tex_data
    assert skin[0] > skin[1] > skin[2]
