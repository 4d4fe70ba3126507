"""A demonstration with depth, from its frames to the errors in space; and what is said without depth."""

import numpy as np
import pytest
import torch

from geoskill.config import FeaturesConfig
from geoskill.data.demonstration import Demonstration
from geoskill.errors import InputError
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.sift import Sift
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.skill.build import build_skill
from geoskill.skill.plan import plan_skill
from geoskill.training.error_changes import error_changes

CAMERA = DepthCamera(100.0, 100.0, 79.5, 59.5)
DEPTH_M = 0.8


def depths(frames: tuple[np.ndarray, ...]) -> list[DepthPicture]:
    """Everything at one depth, unknown at the right."""
    depth_m = np.full(frames[0].shape[:2], DEPTH_M, np.float32)
    depth_m[:, 120:] = np.nan
    return [DepthPicture(depth_m, CAMERA) for _ in frames]


def demonstration(frames: tuple[np.ndarray, ...], kernel: str, *, with_depth: bool = True) -> Demonstration:
    spec = plan_skill(
        kernel,
        ["sift", "lbd"],
        {"name": "bilinear", "hidden_dim": 8},
        FeaturesConfig(max_features=16, min_side=0, color=0.0),
        top_k=4,
    )
    components = build_skill(spec)
    return Demonstration(
        frames,
        components.pipelines,
        components.members,
        gap=2,
        max_span_ratio=0.5,
        num_negatives=3,
        progress=lambda items, text: items,
        use_places=False,
        depths=depths(frames) if with_depth else None,
    )


def test_errors_in_space_are_those_of_the_picture_at_one_depth(demonstration_frames: tuple[np.ndarray, ...]) -> None:
    frames = demonstration_frames[:8]
    shown = demonstration(frames, "p2p_p2p3")
    picture, space = (shown.members[name] for name in ("p2p_sift", "p2p3_sift"))
    meters_per_px = DEPTH_M / CAMERA.focal_x_px
    for index in range(len(shown)):
        graph = shown.graph_without_negatives("p2p3_sift", index)
        in_picture = shown.graph_without_negatives("p2p_sift", index)
        known = graph.point_space.isfinite().all(dim=1)
        assert known.any()
        assert not known.all()
        assert graph.instance_index.shape[1] == known.sum() * (known.sum() - 1) / 2
        assert known[graph.instance_index].all()
        in_picture.instance_index = graph.instance_index
        for name in ("geometry", "next_geometry", "final_xy"):
            expected = picture.control_errors(in_picture, name).norm(dim=1) * meters_per_px
            error = space.control_errors(graph, name).norm(dim=1)
            finite = error.isfinite()
            torch.testing.assert_close(error[finite], expected[finite], atol=1e-5, rtol=1e-4)
        changes = error_changes(space, graph, "absolute")
        assert changes.isfinite().all()


@pytest.mark.parametrize("kernel", ["p2p3", "p2l3", "l2l3", "par3", "copl", "copl2", "p2pl"])
def test_transition_of_a_kernel_in_space_has_negatives_with_depth(
    kernel: str, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    shown = demonstration(demonstration_frames[:4], kernel)
    (name,) = shown.members
    graph = shown[0][name]["first"]
    for node_type in shown.members[name].node_types:
        rows = graph[f"{node_type}_space"]
        assert graph[f"{node_type}_next_space"].shape == graph[f"{node_type}_final_space"].shape == rows.shape
        assert rows[-3:].isfinite().any()


def test_without_depth_a_kernel_in_space_says_what_it_needs(demonstration_frames: tuple[np.ndarray, ...]) -> None:
    expected = r"^kernel=p2p3 needs depth, and the demonstration has none; expected a folder with depth/ and camera"
    with pytest.raises(InputError, match=expected):
        demonstration(demonstration_frames[:4], "p2p3", with_depth=False)


def test_pipeline_in_space_lifts_what_it_finds_and_mirrors_alike(demonstration_frames: tuple[np.ndarray, ...]) -> None:
    frame, depth = demonstration_frames[0], depths(demonstration_frames)[0]
    pipeline = FeaturePipeline(Sift(), max_features=30, min_side=0, in_space=True)
    features = pipeline.extract(frame, depth)
    expected = CAMERA.back_project(features.geometry.astype(np.float64), np.full(len(features), DEPTH_M))
    known = np.isfinite(features.space).all(axis=1)
    np.testing.assert_allclose(features.space[known], expected[known], atol=1e-6)
    mirrored = depth.mirrored()
    left, right = (
        own.camera.back_project(np.array([[x, 9.0]]), np.ones(1)) for own, x in ((depth, 3.0), (mirrored, 156.0))
    )
    np.testing.assert_allclose(left, right * [-1, 1, 1])
    with pytest.raises(InputError, match="in space; expected depth"):
        pipeline.extract(frame)


def test_depth_picture_keeps_places_when_resized() -> None:
    depth_m = np.arange(1, 13, dtype=np.float32).reshape(3, 4)
    picture = DepthPicture(depth_m, DepthCamera(10.0, 20.0, 1.5, 1.0))
    larger = picture.resized(8, 6)
    assert larger.depth_m.shape == (6, 8)
    np.testing.assert_array_equal(larger.depth_m[::2, ::2], depth_m)
    # The center of pixel (2, 1) is that of four pixels of the larger picture.
    expected = picture.camera.back_project(np.array([[2.0, 1.0]]), np.ones(1))
    np.testing.assert_allclose(larger.camera.back_project(np.array([[4.5, 2.5]]), np.ones(1)), expected)
