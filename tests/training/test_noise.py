"""Noise on descriptors has the announced size, whatever their length; hidden features take their instances along."""

from typing import Any

import pytest
import torch
from torch_geometric.data import Batch

from geoskill.graphs.motif_graph import MotifGraph
from geoskill.training.demonstration import Demonstration
from geoskill.training.noise import noisy, with_hidden_features


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
def batch(request: pytest.FixtureRequest, demonstration: Demonstration) -> Any:
    """The first frames of four transitions."""
    return Batch.from_data_list([demonstration[index][request.param]["first"] for index in range(4)])


def instances(graph: MotifGraph) -> set[tuple[int, ...]]:
    """Frame and nodes of each."""
    return {tuple(numbers) for numbers in torch.stack([graph.instance_frame, *graph.instance_index], dim=1).tolist()}


@pytest.mark.parametrize("seed", range(5))
def test_instances_go_with_any_of_their_features(batch: Any, seed: int) -> None:
    reduced = with_hidden_features(batch, 0.4, torch.Generator().manual_seed(seed))
    everything, left = instances(batch), instances(reduced)
    assert set() < left < everything
    assert len(left) == reduced.instance_index.shape[1] == len(reduced.instance_frame)
    roles = batch.roles[0]
    seen = {(role, row) for _, *rows in left for role, row in zip(roles, rows, strict=True)}
    # Whatever is gone has a feature of which all instances are gone.
    for _, *rows in everything - left:
        assert not {*zip(roles, rows, strict=True)} <= seen
    assert (reduced.instance_frame.diff() >= 0).all()


def test_features_stay_where_they_are(batch: Any) -> None:
    before = instances(batch)
    reduced = with_hidden_features(batch, 0.9, torch.Generator().manual_seed(0))
    assert instances(batch) == before
    assert reduced.num_graphs == 4
    for key in ("point_descriptor", "point_geometry", "point_moved", "point_followed", "span_index"):
        assert torch.equal(reduced[key], batch[key])


def test_the_share_of_hidden_features(batch: Any) -> None:
    generator = torch.Generator().manual_seed(0)
    left = [with_hidden_features(batch, 0.3, generator).instance_index.shape[1] for _ in range(300)]
    # Both features of an instance are visible with probability 0.49.
    assert sum(left) / len(left) / batch.instance_index.shape[1] == pytest.approx(0.49, abs=0.03)
    assert len(set(left)) > 10


def test_nothing_and_everything_hidden(batch: Any) -> None:
    assert instances(with_hidden_features(batch, 0.0, torch.Generator())) == instances(batch)
    empty = with_hidden_features(batch, 1.0, torch.Generator())
    assert empty.instance_index.shape == (2, 0)
    assert empty.instance_frame.shape == (0,)


def test_a_single_frame_loses_what_a_batch_of_it_loses(demonstration: Demonstration) -> None:
    graph = demonstration[3]["p2l_sift_lbd"]["first"]
    alone = with_hidden_features(graph, 0.4, torch.Generator().manual_seed(1))
    together = with_hidden_features(Batch.from_data_list([graph]), 0.4, torch.Generator().manual_seed(1))
    assert 0 < alone.instance_index.shape[1] < graph.instance_index.shape[1]
    assert torch.equal(alone.instance_index, together.instance_index)
