"""A skill with members in space, from a picture with depth to associations in meters."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch

from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.plan import plan_skill
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter


@pytest.fixture
def skill_in_space(provenance: Provenance) -> Skill:
    """Return an untrained skill of a point that comes onto a point, and of a line that comes onto a line, in space."""
    features = FeaturesConfig(max_features=12, min_side=0, color=0.0)
    spec = plan_skill(["p2p3", "l2l3"], ["sift", "lbd"], {"name": "bilinear", "hidden_dim": 8}, features, top_k=3)
    return Skill(build_skill(spec, seed=3), spec, provenance)


def flat_depth(picture: np.ndarray, depth_m: float) -> DepthPicture:
    return DepthPicture(np.full(picture.shape[:2], depth_m, np.float32), DepthCamera(100.0, 100.0, 79.5, 59.5))


def test_errors_in_space_are_in_meters_with_the_noise_of_depth(
    skill_in_space: Skill, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    skill, picture = skill_in_space, demonstration_frames[0]
    near, far = (skill.infer(picture, depth=flat_depth(picture, depth_m)) for depth_m in (0.5, 1.0))
    assert near.error_units == ("m",) * 9
    for one, other in zip(near.associations, far.associations, strict=True):
        np.testing.assert_allclose(np.array(other.error), 2 * np.array(one.error), atol=1e-5)
    for association in far.associations:
        line = association.as_json()
        assert line["unit"] == "m"
        assert all(len(np.ravel(node["xyz_m"])) in (3, 6) for node in line["nodes"])
        if association.kernel == "p2p3":
            first, second = (np.array(node.space) for node in association.nodes)
            np.testing.assert_allclose(association.error, first - second, atol=1e-6)
            # Half a pixel at 1 m, and the noise of depth, of two points each.
            z_std = 2**0.5 * DepthCamera(1.0, 1.0, 0.0, 0.0).noise_per_m
            assert association.error_std[2] == pytest.approx(z_std, rel=1e-3)
            assert 2**0.5 * 0.005 < association.error_std[0] < 2**0.5 * 0.0055
        else:
            # The ends in space are in the order of those in the picture.
            for node in association.nodes:
                ends = np.array(node.space).reshape(2, 3)
                np.testing.assert_allclose(
                    ends[:, :2] * 100 + [79.5, 59.5], np.reshape(node.coordinates, (2, 2)), atol=0.05
                )


def test_over_time_an_association_in_space_keeps_its_meters(
    skill_in_space: Skill, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    over_time = TemporalFilter(skill_in_space)
    for picture in demonstration_frames[:6]:
        result = over_time.infer(picture, depth=flat_depth(picture, 0.8))
        for association in result.associations:
            assert all(node.space is not None for node in association.nodes)
            assert math.hypot(*association.error) < 2 * 0.8 * 160 / 100


def test_depth_that_is_missing_or_of_another_size_is_named(
    skill_in_space: Skill, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    skill, picture = skill_in_space, demonstration_frames[0]
    with pytest.raises(InputError, match=r"^kernel=p2p3 needs depth, and the frame has none; expected"):
        skill.infer(picture)
    with pytest.raises(InputError, match=r"^the depth is 80x60 pixels; expected 160x120, as the frame$"):
        skill.infer(picture, depth=flat_depth(picture[::2, ::2], 0.8))


def test_skill_in_space_is_loaded_as_it_was_saved(
    skill_in_space: Skill, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    picture = demonstration_frames[0]
    depth = flat_depth(picture, 0.8)
    before = skill_in_space.infer(picture, depth=depth)
    member = skill_in_space.members["p2p3_sift"]
    points = before.features["sift"]
    descriptors, places = torch.from_numpy(points.descriptors), torch.from_numpy(points.space)
    nothing = {NodeType.POINT: (descriptors[:0], places[:0])}
    member.goal.fit(
        torch.tensor([True, False]),
        [(descriptors[:3], places[:3]), (descriptors[3:6], places[3:6])],
        {NodeType.POINT: (descriptors, places)},
        nothing,
        {NodeType.POINT: 0.5},
    )
    skill_in_space.save(tmp_path / "skill.ckpt")
    loaded = Skill.load(tmp_path / "skill.ckpt")
    assert torch.equal(loaded.members["p2p3_sift"].goal.node(0)[1], places[:3])
    after = loaded.infer(picture, depth=depth)
    assert [own.error for own in after.associations] == [own.error for own in before.associations]
