"""Probing moves that show how the picture of the carried thing moves."""

from geoskill.control.action import Action, ActionSpace

PROBE_M = 0.010
PROBE_RAD = 0.052359877559829883  # 3 degrees


def probe_of(space: ActionSpace) -> Action:
    """Return the displacement of a probing move in each component, within the limits of a step."""
    step = space.limits
    return space.of(min(PROBE_M, step.step_m), min(PROBE_RAD, step.step_rad))


def probing_moves(space: ActionSpace) -> tuple[Action, ...]:
    """Return the probing moves: to and fro in every degree of freedom, so that they end where they began.

    >>> from geoskill.control.action import Dof
    >>> [move.tolist() for move in probing_moves(ActionSpace((Dof.X, Dof.Y)))]
    [[0.01, 0.0], [-0.01, 0.0], [0.0, 0.01], [0.0, -0.01]]
    """
    probe, moves = probe_of(space), []
    for component in range(len(probe)):
        move = 0.0 * probe
        move[component] = probe[component]
        # Adding zero makes the negative zeros positive, as they are written to the log.
        moves += [move, 0.0 - move]
    return tuple(moves)
