"""What was learned, in words: a sentence for the task, and one for each constraint."""

from collections import Counter
from collections.abc import Iterable, Sequence

from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import NodeRole

NOTHING = "Nothing was learned from the demonstration."


def task_sentence(stages: Sequence[Sequence[Kernel]]) -> str:
    """Return what is done, from the kernels of each stage of the task, in the order of time.

    >>> from geoskill.kernels.l2l import LineToLine
    >>> from geoskill.kernels.p2p import PointToPoint
    >>> task_sentence([[LineToLine()], [PointToPoint()]])
    'A thing is moved until one line comes to lie on another, and then until one point comes onto another.'
    """
    parts = [_listed(dict.fromkeys(kernel.meaning for kernel in stage)) for stage in stages if stage]
    if not parts:
        return NOTHING
    return f"A thing is moved until {', and then until '.join(parts)}."


def constraint_sentence(
    kernel: Kernel, roles: Sequence[NodeRole | None], tolerance: float | None, confidence: float | None, found: bool
) -> str:
    """Return what a member says: which kind of constraint, what moves, what rests, how near, how sure, what is free.

    Args:
        kernel: of the member.
        roles: of its nodes.
        tolerance: norm of the goal error at which it is done, in the unit of the error; None where it is not known.
        confidence: mean confidence of its associations, in [0, 1]; None where none was selected.
        found: whether the selected features come together in the demonstration.

    >>> from geoskill.kernels.p2p import PointToPoint
    >>> constraint_sentence(PointToPoint(), (NodeRole.MOVING, NodeRole.RESTING), 3.0, 0.938, True)
    'One point comes onto another: a moved point and a resting point, done within 3 px; 94 % sure; left free: turns \
about the point.'
    """
    if not found:
        return (
            f"Nothing was learned: in the demonstration, no selected features come together so that {kernel.meaning}."
        )
    parts = [f"{kernel.meaning[:1].upper()}{kernel.meaning[1:]}: {_nodes(kernel, roles)}"]
    parts[0] += ", how near is not known" if tolerance is None else f", done within {_measured(tolerance, kernel.unit)}"
    parts.append("not seen in this video" if confidence is None else f"{100 * confidence:.0f} % sure")
    if kernel.leaves_free:
        parts.append(f"left free: {kernel.leaves_free}")
    return f"{'; '.join(parts)}."


def _measured(value: float, unit: str) -> str:
    """Return a number with its unit; of meters, millimeters.

    >>> _measured(0.00784, "m"), _measured(0.04, "")
    ('7.84 mm', '0.04')
    """
    return f"{1000 * value:.3g} mm" if unit == "m" else f"{value:.3g} {unit}".rstrip()


def _nodes(kernel: Kernel, roles: Sequence[NodeRole | None]) -> str:
    """Name the nodes, such as ``a moved point and 2 resting lines``."""
    words = {NodeRole.MOVING: "moved ", NodeRole.RESTING: "resting ", None: ""}
    counts = Counter((role, kind) for role, kind in zip(roles, kernel.roles, strict=True))
    return _listed(
        f"{'a' if count == 1 else count} {words[role]}{kind}{'' if count == 1 else 's'}"
        for (role, kind), count in counts.items()
    )


def _listed(parts: Iterable[str]) -> str:
    texts = list(parts)
    return " and ".join(filter(None, [", ".join(texts[:-1]), texts[-1]]))
