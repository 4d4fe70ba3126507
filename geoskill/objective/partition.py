"""The partition function of the variational expert: Z(r) = E[exp(x)], x ~ N(r, sigma0²) truncated to [-1, 1].

Here r is the reward of the observed transition, in [-1, 1], and sigma0 the standard deviation of the rewards that the
expert's other actions would have earned. The likelihood of a transition is f(r) = r - log Z(r), strictly increasing.
Source: Jin et al., ICRA 2020, equations 9, 11 and 13 to 15; docs/method.md, The exact partition function.
"""

import math
from statistics import NormalDist
from typing import Any, Final, final

import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.errors import InputError

SIGMA0_RANGE: Final = (1e-3, 1e3)
"""Standard deviations for which every function here is accurate in float32; beyond them f is a step or a line."""


def check_sigma0(sigma0: float) -> None:
    """Check a standard deviation of the expert's rewards.

    Raises:
        InputError: when it is outside :data:`SIGMA0_RANGE`.
    """
    lowest, highest = SIGMA0_RANGE
    if not lowest <= sigma0 <= highest:
        raise InputError(f"sigma0={sigma0}: expected a standard deviation from {lowest:g} to {highest:g}")


def log_partition(reward: Float[Tensor, "*batch"], sigma0: float) -> Float[Tensor, "*batch"]:
    """Return the closed form of log Z(r).

    With a = (-1 - r)/s, b = (1 - r)/s and the normal CDF Φ,

        log Z(r) = r + s²/2 + log[Φ(b - s) - Φ(a - s)] - log[Φ(b) - Φ(a)],

    rearranged so that nothing cancels or underflows, in value and gradient, in float32 and float64. Half precision
    is computed in float32.

    Args:
        reward: r in [-1, 1], ends included.
        sigma0: s, a standard deviation.

    Raises:
        InputError: when sigma0 is outside :data:`SIGMA0_RANGE`.

    At sigma0 = 2 and r = 0:

    >>> log_partition(torch.zeros(1), 2.0)
    tensor([0.1564])
    """
    check_sigma0(sigma0)
    working = torch.promote_types(reward.dtype, torch.float32)
    log_z: Float[Tensor, "*batch"] = _LogPartition.apply(reward.to(working), sigma0)  # type: ignore[no-untyped-call]
    return log_z.to(reward.dtype)


def sample_truncated_normal(
    reward: Float[Tensor, "*batch"], sigma0: float, samples: int, generator: torch.Generator | None = None
) -> Float[Tensor, " samples *batch"]:
    """Draw independently from N(r, sigma0²) truncated to [-1, 1], by inversion of its CDF; no gradient flows.

    Args:
        reward: r in [-1, 1], the mean before truncation.
        sigma0: the standard deviation before truncation.
        samples: number of draws per reward, along a new first dimension.
        generator: draws on its own device, so that one on the CPU gives the same draws for rewards on any device;
            None for the default generator of the reward's device.

    Raises:
        InputError: when sigma0 is outside :data:`SIGMA0_RANGE`.
    """
    check_sigma0(sigma0)
    mean = reward.detach()
    device = mean.device if generator is None else generator.device
    uniform = torch.rand((samples, *mean.shape), dtype=mean.dtype, device=device, generator=generator).to(mean.device)
    # erf rather than Φ: the interval always contains the mean, and erf keeps full precision around it.
    lower = torch.erf((-1 - mean) / (sigma0 * math.sqrt(2)))
    upper = torch.erf((1 - mean) / (sigma0 * math.sqrt(2)))
    standard = math.sqrt(2) * torch.erfinv(torch.lerp(lower, upper, uniform))
    return (mean + sigma0 * standard).clamp(-1, 1)


def log_partition_monte_carlo(
    reward: Float[Tensor, "*batch"],
    sigma0: float,
    value_samples: int,
    gradient_samples: int,
    generator: torch.Generator | None = None,
    *,
    baseline: bool = False,
) -> Float[Tensor, "*batch"]:
    """Estimate log Z(r) from samples, as the paper does; once differentiable.

    The value comes from s1 samples (equation 13), the gradient from s2 other samples by the score function (equations
    14 and 15, with phi read as the normal CDF, design choice 7), divided by the sampled Z.

    Args:
        reward: r in [-1, 1].
        sigma0: a standard deviation.
        value_samples: s1, at least 1.
        gradient_samples: s2, at least 1.
        generator: of :func:`sample_truncated_normal`.
        baseline: subtract the first samples' mean of exp(x) from exp(x) in equation 14. The mean score is zero, so
            the expected gradient of Z stays, and the RMSE of the slope about halves (docs/method.md, The exact
            partition function).

    Raises:
        InputError: when sigma0 is outside :data:`SIGMA0_RANGE`.
    """
    partition = sample_truncated_normal(reward, sigma0, value_samples, generator).exp().mean(dim=0)
    samples = sample_truncated_normal(reward, sigma0, gradient_samples, generator)
    weights = samples.exp() - partition if baseline else samples.exp()
    slope = (weights * _score(samples, reward.detach(), sigma0)).mean(dim=0) / partition
    # The bracket is zero: it adds nothing to the value and passes the sampled slope to the gradient.
    return partition.log() + slope * (reward - reward.detach())


def sigma0_from_confidence(alpha: float) -> float:
    """Return the standard deviation for a demonstrator of confidence alpha: alpha = erf(1 / (sigma0 sqrt 2)).

    The authors' map is unpublished; this one is ours (design choice 9, docs/design-choices.md): alpha is the
    probability that an untruncated N(0, sigma0²) falls into [-1, 1]. More confidence means a smaller sigma0.

    Raises:
        InputError: when alpha is not inside (0, 1), or so small that sigma0 leaves :data:`SIGMA0_RANGE`.

    >>> round(sigma0_from_confidence(0.931), 3)
    0.55
    """
    if not 0 < alpha < 1:
        raise InputError(f"alpha={alpha}: expected a number between 0 and 1, both excluded")
    # The lower tail (1 - alpha)/2, unlike the upper one, is exact for alpha near 1.
    sigma0 = -1 / NormalDist().inv_cdf((1 - alpha) / 2)
    if sigma0 > SIGMA0_RANGE[1]:
        lowest = confidence_from_sigma0(SIGMA0_RANGE[1])
        raise InputError(f"alpha={alpha}: expected at least {lowest:.2g}")
    return sigma0


def confidence_from_sigma0(sigma0: float) -> float:
    """Return the confidence for a standard deviation, the inverse of :func:`sigma0_from_confidence`.

    Rounds to 1 for sigma0 below 0.12.

    Raises:
        InputError: when sigma0 is outside :data:`SIGMA0_RANGE`.

    >>> round(confidence_from_sigma0(0.55), 3)
    0.931
    """
    check_sigma0(sigma0)
    return math.erf(1 / (sigma0 * math.sqrt(2)))


@final
class _LogPartition(torch.autograd.Function):
    """The closed form with its closed-form slope: automatic differentiation of erfcx loses digits at large sigma0."""

    @staticmethod
    def forward(ctx: Any, reward: Tensor, sigma0: float) -> Tensor:
        ctx.save_for_backward(reward)
        ctx.sigma0 = sigma0
        return _value(reward, sigma0)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, None]:
        (reward,) = ctx.saved_tensors
        return grad_outputs[0] * _slope(reward, ctx.sigma0), None


def _value(reward: Tensor, s: float) -> Tensor:
    lower, upper = (-1 - reward) / s, (1 - reward) / s
    # Weighting the density by exp(x) moves its mean to r + s². While that stays in [-1, 1] the masses are sums of
    # two non-negative terms; beyond, r + s²/2 and the log of the tail grow against each other and are merged first.
    inside = reward + s**2 / 2 + _central_mass(lower - s, upper - s).log()
    outside = 1 - upper.square() / 2 + _scaled_tail_mass(reward, s).log()
    return torch.where(reward + s**2 <= 1, inside, outside) - _central_mass(lower, upper).log()


def _slope(reward: Tensor, s: float) -> Tensor:
    """Return d log Z / dr = 1 - [φ(b-s) - φ(a-s)] / (s [Φ(b-s) - Φ(a-s)]) + [φ(b) - φ(a)] / (s [Φ(b) - Φ(a)])."""
    lower, upper = (-1 - reward) / s, (1 - reward) / s
    inside = (_density(upper - s) - _density(lower - s)) / _central_mass(lower - s, upper - s)
    outside = (1 - _end_ratio(reward, s)) / (math.sqrt(2 * math.pi) * _scaled_tail_mass(reward, s))
    weighted = torch.where(reward + s**2 <= 1, inside, outside)
    plain = (_density(upper) - _density(lower)) / _central_mass(lower, upper)
    return 1 + (plain - weighted) / s


def _score(samples: Tensor, reward: Tensor, s: float) -> Tensor:
    """Return d log p(x; r) / dr of the truncated normal (equation 15)."""
    lower, upper = (-1 - reward) / s, (1 - reward) / s
    return (samples - reward) / s**2 + (_density(upper) - _density(lower)) / (s * _central_mass(lower, upper))


def _density(x: Tensor) -> Tensor:
    return torch.exp(-x.square() / 2) / math.sqrt(2 * math.pi)


def _central_mass(lower: Tensor, upper: Tensor) -> Tensor:
    """Return Φ(upper) - Φ(lower) for lower <= 0 <= upper; an upper below 0, which callers discard, is taken as 0."""
    return (torch.erf(upper.clamp(min=0) / math.sqrt(2)) - torch.erf(lower / math.sqrt(2))) / 2


def _end_ratio(reward: Tensor, s: float) -> Tensor:
    """Return φ(a - s) / φ(b - s) = exp(-2 (r + s²) / s²), for r + s² >= 1."""
    return torch.exp(-2 * (reward + s**2).clamp(min=1) / s**2)


def _scaled_tail_mass(reward: Tensor, s: float) -> Tensor:
    """Return [Φ(b - s) - Φ(a - s)] exp((b - s)² / 2) for r + s² >= 1, where both ends are in the lower tail."""
    near = (s - (1 - reward) / s).clamp(min=0) / math.sqrt(2)
    far = (s + (1 + reward) / s) / math.sqrt(2)
    mass: Tensor = (torch.special.erfcx(near) - _end_ratio(reward, s) * torch.special.erfcx(far)) / 2
    return mass
