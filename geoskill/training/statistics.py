"""Everything that is fitted to a demonstration before training, in one order."""

from collections.abc import Mapping

from geoskill.config import ObjectiveConfig
from geoskill.data.transitions import Transitions
from geoskill.model.kernel_model import KernelModel
from geoskill.training.error_changes import fit_reward_scale
from geoskill.training.node_order import fit_node_order


def fit_statistics(
    members: Mapping[str, KernelModel],
    demonstration: Transitions,
    objective: ObjectiveConfig,
    descriptor_noise: float,
    *,
    keep_prototypes: bool = False,
) -> None:
    """Fit prototypes, the scale of the reward, and the order of nodes, each of which may need those before it.

    What depends on trained weights is fitted when training ends (:func:`~geoskill.training.calibration.calibrate`). All
    are buffers, so that a checkpoint holds them.

    Args:
        members: by name, untrained.
        demonstration: the transitions.
        objective: gives the change of error that is rewarded, and the scale of the reward.
        descriptor_noise: norm of the noise over the norm of a descriptor.
        keep_prototypes: leave the prototypes as they are, for members whose weights belong to them.

    Raises:
        InputError: when no instance of a member moves.
    """
    if not keep_prototypes:
        for name, member in members.items():
            member.scorer.fit_prototypes(demonstration.descriptors(name))
    fit_reward_scale(dict(members), demonstration, objective)
    fit_node_order(dict(members), demonstration, objective, descriptor_noise)
