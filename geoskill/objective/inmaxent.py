"""The InMaxEnt objective of a batch of transitions, to be maximized.

    mean over transitions of (r - log Z(r))  -  lambda · mean RSW of both frames  -  weight · mean goal of both frames

Source: Jin et al., ICRA 2020, equation 11 with the RSW regularizer and Algorithm 1; design choices 6, 10 and 13
(docs/design-choices.md) and docs/method.md, Reward. The goal term is ours (:mod:`geoskill.objective.goal`).
"""

from dataclasses import dataclass
from typing import final

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.objective.goal import goal_divergence
from geoskill.objective.partition import log_partition, log_partition_monte_carlo
from geoskill.objective.reward import overall_error, reward, tracked_change
from geoskill.objective.selection import residual_sum_of_weights


@final
@dataclass(frozen=True, eq=False)
class FrameSelection:
    """The selection in a batch of frames, with the errors and changes that it is judged by.

    Attributes:
        select_out: ``[m]``, g of every instance; sums to 1 over each frame.
        errors: ``[m, d]``, control error E of every instance.
        change: ``[m]``, change of norm(E) from the earlier to the later frame of the transition, of this frame's own
            instance tracked to the other frame; 0 when it could not be tracked.
        batch: ``[m]``, the frame of each instance, sorted, counted from 0.
        num_frames: number of frames, those without any instance included; frame i belongs to transition i.
        goal_progress: ``[m]``, of every instance (:func:`~geoskill.objective.goal.goal_progress`); only the goal term
            needs it.
        scores: ``[m]``, b; only the goal term needs it.
        by_progress: ``[num_frames]``, whether the goal term of a frame counts by its expected progress; None for none.

    Raises:
        ValueError: when the tensors disagree in length, or there is no frame.
    """

    select_out: Float[Tensor, " m"]
    errors: Float[Tensor, "m d"]
    change: Float[Tensor, " m"]
    batch: Int[Tensor, " m"]
    num_frames: int
    goal_progress: Float[Tensor, " m"] | None = None
    scores: Float[Tensor, " m"] | None = None
    by_progress: Bool[Tensor, " frames"] | None = None

    def __post_init__(self) -> None:
        lengths = (len(self.select_out), len(self.errors), len(self.change), len(self.batch))
        if len(set(lengths)) != 1:
            raise ValueError(f"select_out, errors, change and batch have {lengths} rows; expected the same number")
        for name in ("goal_progress", "scores"):
            values = getattr(self, name)
            if values is not None and len(values) != len(self.batch):
                raise ValueError(f"{name} has {len(values)} rows for {len(self.batch)} instances; expected as many")
        if self.num_frames < 1:
            raise ValueError(f"num_frames={self.num_frames}: expected at least 1")


@final
@dataclass(frozen=True, eq=False)
class ObjectiveValue:
    """The objective and its terms as differentiable scalar tensors.

    Attributes:
        objective: to be maximized.
        reward: mean r of the transitions, in [-1, 1].
        rsw: mean residual sum of weights over all frames, in [0, 1].
        goal: mean divergence from the goal over all frames, 0 or more, in nats; 0 when its weight is 0.
        error: mean magnitude of Ec over all frames, in the control error's unit; a frame without instance counts as 0.
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
    """Compute the objective of a batch of transitions.

    With ``settings.reward`` ``tracked`` a transition has two rewards, one from the instances of its earlier frame and
    one from those of its later frame, and counts with the mean of their likelihoods r - log Z(r); a frame without
    instances has r = 0. With ``frame`` it has one reward, from norm(Ec) later minus earlier, which is 0 when either
    frame has no instance (its Ec of 0 would pass for a decrease or an increase).

    Args:
        settings: terms and constants of the objective.
        beta: of :func:`~geoskill.objective.reward.beta_from_changes`, one for all or one for each transition.
        first: the earlier frames of the transitions.
        second: the later frames, in the same order.
        generator: of the Monte-Carlo samples; the exact partition function draws none.

    Raises:
        ValueError: when the two selections have different numbers of frames, or the goal has a weight and a selection
            lacks progress or scores.
    """
    if first.num_frames != second.num_frames:
        counts = f"{first.num_frames} earlier and {second.num_frames} later frames"
        raise ValueError(f"the transitions have {counts}; expected the same number")
    both = (first, second)
    error_first, error_second = (_overall_error(settings, frames) for frames in both)
    if settings.reward == "tracked":
        changes = torch.cat([_tracked_change(frames) for frames in both])
        if isinstance(beta, Tensor) and beta.ndim == 1:
            beta = torch.cat([beta, beta])
    else:
        comparable = _has_instance(first) & _has_instance(second)
        changes = torch.where(comparable, error_second - error_first, 0.0)
    rewards = reward(changes, beta)
    likelihood = (rewards - _log_partition(settings, rewards, generator)).mean()
    rsw = torch.cat([_rsw(settings, frames) for frames in both]).mean()
    goal = torch.cat([_goal(settings, frames) for frames in both]).mean()
    return ObjectiveValue(
        objective=likelihood - settings.rsw_weight * rsw - settings.goal_weight * goal,
        reward=rewards.mean(),
        rsw=rsw,
        goal=goal,
        error=torch.cat([error_first, error_second]).mean(),
    )


def _overall_error(settings: ObjectiveConfig, frames: FrameSelection) -> Float[Tensor, " frames"]:
    return overall_error(frames.select_out, frames.errors, frames.batch, frames.num_frames, settings.error_reduction)


def _tracked_change(frames: FrameSelection) -> Float[Tensor, " frames"]:
    return tracked_change(frames.select_out, frames.change, frames.batch, frames.num_frames)


def _rsw(settings: ObjectiveConfig, frames: FrameSelection) -> Float[Tensor, " frames"]:
    return residual_sum_of_weights(frames.select_out, frames.batch, frames.num_frames, settings.top_k)


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
        frames.by_progress,
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
