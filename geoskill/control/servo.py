"""One step of the loop, a pure function of what is seen and what is remembered.

::

    sighting -> motion field, who moves -> rows -> robust step -> limits -> decision

The order of a run: probing moves, steps until the error no longer falls, terminal frames, done. Without associations
the command is halved in each frame; after a while the actor goes back a little, waits again, and the run is lost.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from geoskill.control.action import Action, Dof
from geoskill.control.descent import Descent, Guided, guided_down
from geoskill.control.exploration import probing_moves
from geoskill.control.image_motion import ImageMotion, StillMotion
from geoskill.control.law import Step, step_of
from geoskill.control.perceive import perceived, with_roles
from geoskill.control.rows import Row, rows_of
from geoskill.control.safety import plausible, safe_action, usable, way_back
from geoskill.control.sequence import advanced, weights_of
from geoskill.control.state import Decision, Mode, Record, ServoState, Setup, Sighting
from geoskill.control.stopping import GROWTH_FRAMES, averaging, is_growing, is_settled, near_goal, terminal_gain
from geoskill.control.who_moves import Ledger
from geoskill.geometry.uncertainty import DETECTION_STD_PX

REMEMBERED: Final = 64
"""Frames of history that are kept."""
MAX_EXPLORATIONS: Final = 2

Result = tuple[Decision, ServoState, Record]


def initial_state(setup: Setup, *, explores: bool = True) -> ServoState:
    """Return the state before the first step.

    Args:
        setup: of the run.
        explores: whether it begins with probing moves; not needed where the field is known.
    """
    rest = np.zeros(len(setup.space.dofs))
    cameras = len(setup.sizes)
    return ServoState(
        Mode.EXPLORE if explores else Mode.SERVO, rest, rest, (None,) * cameras, (Ledger.empty(),) * cameras
    )


def step(setup: Setup, state: ServoState, sighting: Sighting) -> Result:
    """Return the decision on a sighting, the next state, and the record of both.

    Args:
        setup: of the run.
        state: of the last step.
        sighting: what is known now.
    """
    if state.mode in (Mode.DONE, Mode.LOST):
        return _ended(setup, state, state.mode, "the run has ended")
    sighting = replace(sighting, acted=plausible(setup.space, sighting.acted))
    state = _moved(state, sighting.acted)
    state = perceived(setup, state, sighting)
    rows, state = _rows(setup, state, sighting)
    if state.frame >= setup.config.max_frames:
        return _ended(setup, state, Mode.LOST, f"not settled after {setup.config.max_frames} frames")
    if state.mode is Mode.EXPLORE:
        moves = probing_moves(setup.space)
        if state.probe < len(moves):
            return _probed(setup, state, moves[state.probe])
        if sighting.motions is None and not setup.uses_slots and all(own is None for own in state.motions):
            return _ended(setup, state, Mode.LOST, "nothing moved in the picture when the actor moved")
        state = replace(state, mode=Mode.SERVO, probing=False)
    if not rows:
        return _held(setup, state)
    return _driven(setup, replace(state, held=0, back=(), probing=False), rows, sighting.touched)


def _moved(state: ServoState, acted: Action | None) -> ServoState:
    """Return the state with the displacement that was carried out; where that is not known, the command is believed."""
    own = state.command if acted is None else acted
    return replace(state, travelled=state.travelled + own, way=(*state.way, own)[-REMEMBERED:])


def _rows(setup: Setup, state: ServoState, sighting: Sighting) -> tuple[list[Row], ServoState]:
    """Return the rows that may drive, and the state with Broyden's Jacobians updated where they are used."""
    motions: Sequence[ImageMotion | None] = state.motions if sighting.motions is None else sighting.motions
    if setup.uses_slots:
        motions = [StillMotion(len(setup.space.dofs))] * len(setup.sizes)
    constraints = [
        own
        for own in sighting.constraints
        if 0 <= own.camera < len(motions)
        and motions[own.camera] is not None
        and usable(own, setup.sizes[own.camera], setup.config.min_confidence)
    ]
    constraints = with_roles(constraints, state.ledgers)
    rows = rows_of(constraints, [StillMotion(len(setup.space.dofs)) if own is None else own for own in motions])
    rows = [row for row in rows if np.isfinite(row.error).all() and np.isfinite(row.jacobian).all()]
    if setup.uses_slots:
        slots = state.slots.advanced(rows, state.way[-1], setup.space, state.probing)
        return slots.applied(rows, setup.space), replace(state, slots=slots)
    if setup.phases:
        weights = weights_of(setup.phases, state.phase)
        rows = [replace(row, weight=weights.get(row.constraint.member, 1.0)) for row in rows]
    return rows, state


def _probed(setup: Setup, state: ServoState, move: Action) -> Result:
    action = safe_action(setup.space, state.travelled, move)
    notes = ("explore",) if state.probe == 0 else ()
    state = replace(state, probe=state.probe + 1, probing=True)
    return _sent(setup, state, Decision(Mode.EXPLORE, action), notes=notes)


def _held(setup: Setup, state: ServoState) -> Result:
    """Slow down, wait, go back a little, wait again, and give up."""
    config, held = setup.config, state.held + 1
    state = replace(state, held=held, mode=Mode.HOLD, probing=False)
    reason = "no association to go by"
    action = 0.5 * state.command if held <= config.hold_frames else np.zeros(len(state.command))
    if held == config.hold_frames + 1:
        state = replace(state, back=tuple(way_back(state.way, setup.space, config.retreat_mm / 1000)))
    if held > config.hold_frames and state.back:
        action, reason = state.back[0], "goes back the way it came"
        state = replace(state, back=state.back[1:], held=config.hold_frames + 1)
    elif held > 2 * config.hold_frames:
        return _ended(setup, state, Mode.LOST, "no association for too long")
    return _sent(setup, state, Decision(Mode.HOLD, safe_action(setup.space, state.travelled, action), reason))


def _driven(setup: Setup, state: ServoState, rows: list[Row], touched: bool) -> Result:
    """Drive by the rows."""
    config, space = setup.config, setup.space
    guided, descent = _guided(setup, state, touched)
    state = replace(state, descent=descent)
    if descent.is_stuck and not descent.landed:
        return _ended(setup, state, Mode.LOST, "something that is not the support is in the way down")
    at_support = guided.at_support
    if at_support != state.supported:  # on the way down the error need not fall
        state = replace(state, supported=at_support, history=())
    driven = [index for index, dof in enumerate(space.dofs) if not (setup.guarded and dof is Dof.Z)]
    terminal = state.terminal > 0  # and stays so after a frame without associations
    if terminal:
        rows = near_goal(rows, state.history)
        if not rows:
            return _held(setup, state)
    gain = terminal_gain(config.gain, state.terminal) if terminal else config.gain
    wanted = step_of(rows, space, driven, guided.drift, gain, guided.ahead)
    state = _measured(setup, state, wanted)
    history = (*state.history, wanted.rms)[-REMEMBERED:]
    phase = advanced(setup.phases, state.phase, _member_errors(rows, wanted))
    state = replace(state, mode=Mode.TERMINAL if terminal else Mode.SERVO, rms=wanted.rms, history=history, phase=phase)
    settled = terminal or (
        at_support and phase.phase >= len(setup.phases) - 1 and is_settled(history, config.settle_px)
    )
    if settled:
        state = replace(state, mode=Mode.TERMINAL, terminal=state.terminal + 1)
        if state.terminal > config.terminal_frames:
            return _done(setup, state, rows, wanted)
    smoothed = config.smoothing * state.command + (1 - config.smoothing) * wanted.action
    for index in set(range(len(space.dofs))) - set(driven):
        smoothed[index] = guided.action[index]
    action = safe_action(space, state.travelled, smoothed)
    limited = not np.array_equal(action, smoothed)
    if not settled and not limited and is_growing(history):
        return _explore_again(setup, state)
    notes = ("limited",) if limited else ()
    return _sent(setup, state, Decision(state.mode, action), rows, wanted, notes)


def _guided(setup: Setup, state: ServoState, touched: bool) -> tuple[Guided, Descent]:
    """Return what the way down asks for; nothing where the picture drives z, or at the end."""
    rest = np.zeros(len(setup.space.dofs))
    if not setup.guarded or Dof.Z not in setup.space.dofs:
        return Guided(rest, rest, rest, True), state.descent
    if state.terminal > 0:  # pressing on is of no use
        return Guided(rest, rest, rest, state.supported), state.descent
    return guided_down(setup.config, setup.space, state.descent, state.travelled, state.rms, touched)


def _measured(setup: Setup, state: ServoState, wanted: Step) -> ServoState:
    """Return the state with what a picture said about the height."""
    z = setup.space.index(Dof.Z)
    if z is None or state.supported:
        return state
    return replace(state, descent=state.descent.seen(float(state.travelled[z]), wanted.height))


def _member_errors(rows: Sequence[Row], wanted: Step) -> dict[str, float]:
    """Return the median norm of the error of each member's rows that count."""
    norms: dict[str, list[float]] = {}
    for row, weight in zip(rows, wanted.weights, strict=True):
        if weight > 0:
            norms.setdefault(row.constraint.member, []).append(float(np.linalg.norm(row.error)))
    return {member: float(np.median(own)) for member, own in norms.items()}


def _explore_again(setup: Setup, state: ServoState) -> Result:
    """Explore once more, since the field must be wrong where the error grows; then give up."""
    if state.explorations >= MAX_EXPLORATIONS:
        return _ended(setup, state, Mode.LOST, f"the error grew for {GROWTH_FRAMES} frames, after exploring again, too")
    state = replace(
        state,
        mode=Mode.EXPLORE,
        probe=0,
        explorations=state.explorations + 1,
        motions=(None,) * len(state.motions),
        ledgers=(Ledger.empty(),) * len(state.ledgers),
        rms=float("inf"),
        history=(),
    )
    return _probed(setup, state, probing_moves(setup.space)[0])


def _done(setup: Setup, state: ServoState, rows: list[Row], wanted: Step) -> Result:
    noise = 2 * DETECTION_STD_PX**2
    # Noise is averaged over the terminal frames; pairs that do not meet stay as they are.
    left = noise * averaging(setup.config.gain, state.terminal) + max(0.0, wanted.residual_variance - noise)
    std = np.sqrt(left) * wanted.unit_std
    turns = np.array([dof.is_rotation for dof in setup.space.dofs])
    rest = np.zeros(len(state.command))
    decision = Decision(
        Mode.DONE,
        rest,
        predicted_mm=1000 * float(np.linalg.norm(std[~turns])),
        predicted_deg=float(np.degrees(np.linalg.norm(std[turns]))),
    )
    return _sent(setup, replace(state, mode=Mode.DONE), decision, rows, wanted)


def _ended(setup: Setup, state: ServoState, mode: Mode, reason: str) -> Result:
    rest = np.zeros(len(setup.space.dofs))
    return _sent(setup, replace(state, mode=mode), Decision(mode, rest, reason))


def _sent(
    setup: Setup,
    state: ServoState,
    decision: Decision,
    rows: Sequence[Row] = (),
    wanted: Step | None = None,
    notes: tuple[str, ...] = (),
) -> Result:
    weights = [] if wanted is None else wanted.weights.tolist()
    rank, rms = (0, None) if wanted is None else (wanted.rank, wanted.rms)
    record = Record(state.frame, decision, rows, weights, rank, rms, notes)
    return decision, replace(state, command=decision.action, frame=state.frame + 1), record
