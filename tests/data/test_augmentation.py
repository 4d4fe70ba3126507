"""Noise on descriptors has the announced size, whatever their length; of features as many are hidden as is said."""

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
def test_the_expected_squared_norm_is_that_of_the_strength(width: int, strength: float) -> None:
    descriptors = unit(4000, width)
    noise = noisy(descriptors, strength, torch.Generator().manual_seed(1)) - descriptors
    # The mean of 4000 chi-squares of at least 72 degrees of freedom: relative SD sqrt(2 / 72 / 4000) = 0.0026.
    assert float(noise.square().sum(dim=1).mean()) == pytest.approx(strength**2, rel=0.015)
    assert float(noise.mean()) == pytest.approx(0, abs=0.01 * strength)
    # Every component alike, and independent of the descriptor.
    torch.testing.assert_close(noise.std(dim=0), torch.full((width,), strength / width**0.5), rtol=0.08, atol=0)
    assert float((noise * descriptors).sum(dim=1).mean()) == pytest.approx(0, abs=0.01 * strength)


def test_the_generator_decides() -> None:
    descriptors = unit(3, 5)
    one, same, other = (noisy(descriptors, 0.5, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert torch.equal(one, same)
    assert not torch.allclose(one, other)
    generator = torch.Generator().manual_seed(1)
    assert torch.equal(noisy(descriptors, 0.5, generator), one)
    assert not torch.allclose(noisy(descriptors, 0.5, generator), one)


def test_no_strength_no_noise() -> None:
    descriptors = unit(3, 5)
    assert torch.equal(noisy(descriptors, 0.0, torch.Generator()), descriptors)


def test_the_given_descriptors_stay() -> None:
    descriptors = unit(3, 5)
    before = descriptors.clone()
    noisy(descriptors, 0.5, torch.Generator())
    assert torch.equal(descriptors, before)


def test_no_descriptors() -> None:
    assert noisy(torch.zeros(0, 7), 0.5, torch.Generator()).shape == (0, 7)


@pytest.fixture(scope="module", params=["p2p_sift", "p2l_sift_lbd"])
def member(request: pytest.FixtureRequest, training: Any) -> KernelModel:
    found: KernelModel = training.members()[request.param]
    return found


@pytest.fixture(scope="module")
def batch(member: KernelModel, request: pytest.FixtureRequest, demonstration: Demonstration) -> Any:
    """The first frames of four transitions."""
    name = f"{member.kernel.name}_{member.descriptor.replace('+', '_')}"
    return Batch.from_data_list([demonstration[index][name]["first"] for index in range(4)])


def drawn(
    batch: MotifGraph, member: KernelModel, share: float, most: int | None = None, seed: int = 0
) -> dict[NodeType, torch.Tensor]:
    return sample_visible(batch, member.node_types, share, most, torch.Generator().manual_seed(seed))


@pytest.mark.parametrize("seed", range(3))
def test_the_same_are_drawn_again_for_the_same_seed(batch: Any, member: KernelModel, seed: int) -> None:
    one, same, other = (drawn(batch, member, 0.4, seed=number) for number in (seed, seed, seed + 1))
    for kind in member.node_types:
        assert torch.equal(one[kind], same[kind])
        assert not torch.equal(one[kind], other[kind])
        assert len(one[kind]) == batch.node_count(kind)


def test_the_share_of_hidden_features(batch: Any, member: KernelModel) -> None:
    for kind in member.node_types:
        left = [float(drawn(batch, member, 0.3, seed=seed)[kind].float().mean()) for seed in range(300)]
        assert sum(left) / len(left) == pytest.approx(0.7, abs=0.02)
        assert len(set(left)) > 5


def test_nothing_and_everything_hidden(batch: Any, member: KernelModel) -> None:
    for kind in member.node_types:
        assert drawn(batch, member, 0.0)[kind].all()
        assert not drawn(batch, member, 1.0)[kind].any()


def test_of_more_features_as_many_are_visible() -> None:
    """Frames of 400, 100, 40 and 0 features, of which 50 or half are to be visible: 50, 50, 20 and 0."""
    frames = Batch.from_data_list(
        [feature_graph(PointToPoint(), {NodeType.POINT: points(n)}) for n in (400, 100, 40, 0)]
    )
    sums = torch.zeros(4)
    for seed in range(300):
        visible = sample_visible(frames, (NodeType.POINT,), 0.5, 50, torch.Generator().manual_seed(seed))
        sums += torch.stack([part.sum() for part in visible[NodeType.POINT].split([400, 100, 40, 0])])
    # SDs of the means of 300 binomial draws: at most 0.4.
    torch.testing.assert_close(sums / 300, torch.tensor([50.0, 50, 20, 0]), atol=1.6, rtol=0)
    unlimited = sample_visible(frames, (NodeType.POINT,), 0.0, None, torch.Generator())
    assert unlimited[NodeType.POINT].all()


def points(count: int) -> FeatureSet:
    places = np.arange(2 * count, dtype=np.float32).reshape(count, 2)
    return FeatureSet(NodeType.POINT, unit(count, 4).numpy(), places, np.ones(count, np.float32))
