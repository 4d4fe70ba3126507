"""The InMaxEnt objective of a batch of transitions, to be maximized.

    mean over transitions of (r - log Z(r))  -  lambda · mean RSW of both frames  -  weight · mean goal of both frames

Source: Jin et al., ICRA 2020, equation 11 with the RSW regularizer and Algorithm 1; METHOD, settled points 6, 10 and 13
and "The reward is the weak spot, and how to mend it". The goal term is ours (:mod:`geoskill.objective.goal`).
"""

from dataclasses import dataclass
from typing import final

import torch
from jaxtyping import Float, Int
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.objective.goal import goal_divergence
from geoskill.objective.partition import log_partition, log_partition_monte_carlo
from geoskill.objective.reward import overall_error, reward, tracked_change
from geoskill.objective.selection import residual_sum_of_weights


@final
@dataclass(frozen=True, eq=False)
class FrameSelection:
    """What a batch of frames selects, and what that is worth.

    Attributes:
        select_out: ``[m]``, g of every instance; sums to 1 over each frame.
        errors: ``[m, d]``, its control error E.
        change: ``[m]``, change of norm(E) from the earlier to the later frame of the transition, of this frame's own
            instance followed to the other frame; 0 where it could not be followed.
        batch: ``[m]``, the frame of each instance, sorted, counted from 0.
        num_frames: frames in the batch, those without any instance included; frame i belongs to transition i.
        goal_progress: ``[m]``, what each instance earns for having come together by the end of the demonstration
            (:func:`~geoskill.objective.goal.goal_progress`); only the goal term needs it.
        scores: ``[m]``, b; only the goal term needs it.

    Raises:
        ValueError: the tensors disagree in length, or there is no frame.
    """

    select_out: Float[Tensor, " m"]
    errors: Float[Tensor, "m d"]
    change: Float[Tensor, " m"]
    batch: Int[Tensor, " m"]
    num_frames: int
    goal_progress: Float[Tensor, " m"] | None = None
    scores: Float[Tensor, " m"] | None = None

    def __post_init__(self) -> None:
        lengths = (len(self.select_out), len(self.errors), len(self.change), len(self.batch))
        if len(set(lengths)) != 1:
            raise ValueError(f"select_out, errors, change and batch have {lengths} rows; expected the same number")
        for name in ("goal_progress", "scores"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.batch):
                raise ValueError(f"{name} has {len(values)} rows for {len(self.batch)} instances; expected as many")
        if self.num_frames < 1:
            raise ValueError(f"a selection has {self.num_frames} frames; expected at least one")


@final
@dataclass(frozen=True, eq=False)
class ObjectiveValue:
    """The objective and its parts, scalar tensors, all still differentiable.

    Attributes:
        objective: to be maximized.
        reward: mean r of the transitions, in [-1, 1].
        rsw: mean residual sum of weights of all frames, in [0, 1].
        goal: mean divergence from the goal of all frames, 0 or more, in nats; 0 where its weight is 0.
        error: mean magnitude of Ec of all frames, in the control error's unit; a frame without instance counts as 0.
    """

    objective: Float[Tensor, ""]
    reward: Float[Tensor, ""]
    rsw: Float[Tensor, ""]
    goal: Float[Tensor, ""]
    error: Float[Tensor, ""]


def transition_objective(
    settings: ObjectiveConfig,
    beta: float | Float[Tensor, " frames"],
    first: FrameSelection,
    second: FrameSelection,
    generator: torch.Generator | None = None,
) -> ObjectiveValue:
    """The objective over a batch of transitions.

    With ``settings.reward`` ``tracked`` a transition has two rewards, one from the instances of its earlier frame and
    one from those of its later frame, and counts with the mean of their likelihoods r - log Z(r); a frame without
    instances has r = 0. With ``frame`` it has one, from norm(Ec) later minus earlier, which is taken as unchanged
    when either frame has no instance (its Ec of 0 would pass for a decrease or an increase).

    Args:
        settings: what the objective is made of.
        beta: of :func:`~geoskill.objective.reward.beta_from_changes`, one for all or one for each transition.
        first: the earlier frames of the transitions.
        second: the later frames, in the same order.
        generator: of the Monte-Carlo samples; the exact partition function draws none.

    Raises:
        ValueError: the two selections have different numbers of frames, or the goal counts and one lacks what it needs.
    """
    if first.num_frames != second.num_frames:
        raise ValueError(
            f"the transitions have {first.num_frames} earlier and {second.num_frames} later frames; "
            f"expected the same number"
        )
    error_first, error_second = (
        overall_error(frames.select_out, frames.errors, frames.batch, frames.num_frames, settings.error_reduction)
        for frames in (first, second)
    )
    if settings.reward == "tracked":
        changes = torch.cat(
            [tracked_change(each.select_out, each.change, each.batch, each.num_frames) for each in (first, second)]
        )
    else:
        comparable = _has_instance(first) & _has_instance(second)
        changes = torch.where(comparable, error_second - error_first, 0.0)
    if settings.reward == "tracked" and isinstance(beta, Tensor) and beta.ndim == 1:
        beta = torch.cat([beta, beta])
    rewards = reward(changes, beta)
    likelihood = (rewards - _log_partition(settings, rewards, generator)).mean()
    rsw = torch.cat(
        [
            residual_sum_of_weights(each.select_out, each.batch, each.num_frames, settings.top_k)
            for each in (first, second)
        ]
    ).mean()
    goal = torch.cat([_goal(settings, each) for each in (first, second)]).mean()
    return ObjectiveValue(
        objective=likelihood - settings.rsw_weight * rsw - settings.goal_weight * goal,
        reward=rewards.mean(),
        rsw=rsw,
        goal=goal,
        error=torch.cat([error_first, error_second]).mean(),
    )


def _goal(settings: ObjectiveConfig, frames: FrameSelection) -> Float[Tensor, " frames"]:
    if settings.goal_weight == 0:
        return frames.select_out.new_zeros(frames.num_frames)
    if frames.goal_progress is None or frames.scores is None:
        raise ValueError(
            f"a selection without goal_progress or scores; expected both for goal_weight={settings.goal_weight}"
        )
    return goal_divergence(
        frames.scores,
        frames.goal_progress,
        settings.goal_temperature,
        settings.goal_scale,
        frames.batch,
        frames.num_frames,
    )


def _log_partition(
    settings: ObjectiveConfig, rewards: Float[Tensor, " r"], generator: torch.Generator | None
) -> Float[Tensor, " r"]:
    if settings.partition == "exact":
        return log_partition(rewards, settings.sigma0)
    return log_partition_monte_carlo(
        rewards, settings.sigma0, settings.value_samples, settings.gradient_samples, generator
    )


def _has_instance(frames: FrameSelection) -> Tensor:
    return torch.bincount(frames.batch, minlength=frames.num_frames) > 0
