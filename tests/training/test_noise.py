"""The noise on descriptors has the announced size, whatever their length, and comes from its generator."""

import pytest
import torch

from geoskill.training.noise import noisy


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
