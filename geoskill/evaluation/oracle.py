"""Oracle: best strict accuracy that a demonstration from one viewpoint allows.

A demonstration shows which features meet *as its camera sees them*. The lid of a box that stands on a tile does not
touch the tile: one of its corners and the point of the tile that it hides lie on one line of sight. Seen from another
viewpoint they are apart, although the box is right on its tile. A skill learned from one view cannot know this. The
oracle selects among all instances that meet at the demonstration's goal, and its error in another recording is what
remains.
"""

from collections.abc import Mapping
from statistics import mean, median

from geoskill.evaluation.goal import STRICT_M, errors_at_goal
from geoskill.evaluation.simulated import SimulatedFrame
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.simulation.recording import Recording


def evaluate_oracle(
    kernel: Kernel,
    demonstration: Recording,
    features: Mapping[int, Mapping[NodeType, FeatureSet]],
    recording: Recording,
) -> dict[str, float | None]:
    """Return the strict metrics of all instances of a kernel that meet at the goal of the demonstration.

    Args:
        kernel: kernel of a member.
        demonstration: recording at whose goal the instances meet.
        features: features in some frames of the demonstration, by frame number, of the kernel's node types.
        recording: recording of the same things, arranged differently or from another viewpoint.

    Returns:
        ``oracle_strict_accuracy``, the fraction of those instances with an error of at most 3 mm at the goal of
        ``recording``, and ``oracle_goal_error_mm``, their median error there; both None when no instance meets, or the
        error is no length.
    """
    errors_m: list[float] = []
    for frame, frame_features in features.items() if kernel.unit in ("px", "m") else ():
        demonstrated, seen = SimulatedFrame(demonstration, frame), SimulatedFrame(demonstration, frame, goal=recording)
        demonstrated_m, joins = errors_at_goal(kernel, frame_features, demonstrated, demonstrated.goal_pixel_m)
        seen_m, _ = errors_at_goal(kernel, frame_features, seen, seen.goal_pixel_m)
        errors_m += seen_m[joins & (demonstrated_m <= STRICT_M)].tolist()
    return {
        "oracle_strict_accuracy": mean(error <= STRICT_M for error in errors_m) if errors_m else None,
        "oracle_goal_error_mm": 1000 * median(errors_m) if errors_m else None,
    }
