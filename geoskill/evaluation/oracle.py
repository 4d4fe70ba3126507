"""How much of what meets in one picture meets in another: what strict accuracy a single view lets one expect.

A demonstration shows which features come together *as its camera sees them*. The lid of a box that stands on a tile
does not touch the tile: its corner and a point of the tile that it hides lie on one line of sight, and on no other one.
Seen from elsewhere, the box still right on its tile, the two are apart. A skill that learned from one picture cannot
know; even who knew every point of both things, and chose among those that met there, would be this far off.
"""

from collections.abc import Mapping
from statistics import mean, median

from geoskill.evaluation.goal import STRICT_M, errors_at_goal
from geoskill.evaluation.simulated import SimulatedFrame
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.simulation.recording import Recording


def oracle(
    kernel: Kernel,
    demonstration: Recording,
    features: Mapping[int, Mapping[NodeType, FeatureSet]],
    recording: Recording,
) -> dict[str, float | None]:
    """What the instances of a kernel that meet at one recording's goal come to at another's.

    Args:
        kernel: of a member.
        demonstration: where they meet.
        features: of some of its frames, by number, of the kernel's node types.
        recording: shows the same things in another place, or from elsewhere.

    Returns:
        ``oracle_strict_accuracy``, the share of those instances whose error is within 3 mm there, too, and
        ``oracle_goal_error_mm``, their median error; both None where none meets, or the error is no length.
    """
    errors_m: list[float] = []
    for frame, found in features.items() if kernel.unit == "px" else ():
        here, there = SimulatedFrame(demonstration, frame), SimulatedFrame(demonstration, frame, goal=recording)
        before_m, joins = errors_at_goal(kernel, found, here, here.goal_pixel_m)
        after_m, _ = errors_at_goal(kernel, found, there, there.goal_pixel_m)
        errors_m += after_m[joins & (before_m <= STRICT_M)].tolist()
    return {
        "oracle_strict_accuracy": mean(error <= STRICT_M for error in errors_m) if errors_m else None,
        "oracle_goal_error_mm": 1000 * median(errors_m) if errors_m else None,
    }
