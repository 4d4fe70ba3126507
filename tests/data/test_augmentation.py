"""Noise on descriptors has the expected norm, and features are hidden at the expected rate."""

from typing import Any

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch

from geoskill.data.augmentation import noisy, sample_visible
from geoskill.data.demonstration import Demonstration
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, feature_graph
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.kernel_model import KernelModel


def unit(rows: int, width: int) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(rows, width, generator=torch.Generator().manual_seed(0)), dim=1)


@pytest.mark.parametrize("width", [72, 128, 256])
@pytest.mark.parametrize("strength", [0.1, 0.68, 2.0])
def test_noise_has_the_expected_norm(width: int, strength: float) -> None:
    descriptors = unit(4000, width)
    noise = noisy(descriptors, strength, torch.Generator().manual_seed(1)) - descriptors
    # The mean of 4000 chi-squares of at least 72 degrees of freedom: relative SD sqrt(2 / 72 / 4000) = 0.0026.
    assert float(noise.square().sum(dim=1).mean()) == pytest.approx(strength**2, rel=0.015)
    assert float(noise.mean()) == pytest.approx(0, abs=0.01 * strength)
    # The same in every component, and independent of the descriptor.
    torch.testing.assert_close(noise.std(dim=0), torch.full((width,), strength / width**0.5), rtol=0.08, atol=0)
    assert float((noise * descriptors).sum(dim=1).mean()) == pytest.approx(0, abs=0.01 * strength)


def test_noise_depends_on_the_generator() -> None:
    descriptors = unit(3, 5)
    first, repeated, different = (noisy(descriptors, 0.5, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert torch.equal(first, repeated)
    assert not torch.allclose(first, different)
    generator = torch.Generator().manual_seed(1)
    assert torch.equal(noisy(descriptors, 0.5, generator), first)
    assert not torch.allclose(noisy(descriptors, 0.5, generator), first)


def test_noise_of_zero_strength() -> None:
    descriptors = unit(3, 5)
    assert torch.equal(noisy(descriptors, 0.0, torch.Generator()), descriptors)


def test_noise_does_not_change_its_input() -> None:
    descriptors = unit(3, 5)
    before = descriptors.clone()
    noisy(descriptors, 0.5, torch.Generator())
    assert torch.equal(descriptors, before)


def test_noise_on_no_descriptors() -> None:
    assert noisy(torch.zeros(0, 7), 0.5, torch.Generator()).shape == (0, 7)


@pytest.fixture(scope="module", params=["p2p_sift", "p2l_sift_lbd"])
def member(request: pytest.FixtureRequest, training: Any) -> KernelModel:
    member: KernelModel = training.members()[request.param]
    return member


@pytest.fixture(scope="module")
def batch(member: KernelModel, request: pytest.FixtureRequest, demonstration: Demonstration) -> Any:
    """The first frames of four transitions."""
    name = f"{member.kernel.name}_{member.descriptor.replace('+', '_')}"
    return Batch.from_data_list([demonstration[index][name]["first"] for index in range(4)])


def draw(
    batch: MotifGraph, member: KernelModel, dropout: float, max_visible: int | None = None, seed: int = 0
) -> dict[NodeType, torch.Tensor]:
    return sample_visible(batch, member.node_types, dropout, max_visible, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("seed", range(3))
def test_sample_visible_repeats_with_the_seed(batch: Any, member: KernelModel, seed: int) -> None:
    first, repeated, different = (draw(batch, member, 0.4, seed=number) for number in (seed, seed, seed + 1))
    for node_type in member.node_types:
        assert torch.equal(first[node_type], repeated[node_type])
        assert not torch.equal(first[node_type], different[node_type])
        assert len(first[node_type]) == batch.node_count(node_type)


def test_sample_visible_dropout_rate(batch: Any, member: KernelModel) -> None:
    for node_type in member.node_types:
        visible_shares = [float(draw(batch, member, 0.3, seed=seed)[node_type].float().mean()) for seed in range(300)]
        assert sum(visible_shares) / len(visible_shares) == pytest.approx(0.7, abs=0.02)
        assert len(set(visible_shares)) > 5


def test_sample_visible_with_dropout_zero_and_one(batch: Any, member: KernelModel) -> None:
    for node_type in member.node_types:
        assert draw(batch, member, 0.0)[node_type].all()
        assert not draw(batch, member, 1.0)[node_type].any()


def test_sample_visible_limits_expected_number() -> None:
    """Frames of 400, 100, 40 and 0 features, of which 50 or half are to be visible: 50, 50, 20 and 0."""
    frames = Batch.from_data_list(
        [feature_graph(PointToPoint(), {NodeType.POINT: points(n)}) for n in (400, 100, 40, 0)]
    )
    sums = torch.zeros(4)
    for seed in range(300):
        visible = sample_visible(frames, (NodeType.POINT,), 0.5, 50, torch.Generator().manual_seed(seed))
        sums += torch.stack([frame_mask.sum() for frame_mask in visible[NodeType.POINT].split([400, 100, 40, 0])])
    # SDs of the means of 300 binomial draws: at most 0.4.
    torch.testing.assert_close(sums / 300, torch.tensor([50.0, 50, 20, 0]), atol=1.6, rtol=0)
    unlimited = sample_visible(frames, (NodeType.POINT,), 0.0, None, torch.Generator())
    assert unlimited[NodeType.POINT].all()


def points(count: int) -> FeatureSet:
    xy = np.arange(2 * count, dtype=np.float32).reshape(count, 2)
    return FeatureSet(NodeType.POINT, unit(count, 4).numpy(), xy, np.ones(count, np.float32))
