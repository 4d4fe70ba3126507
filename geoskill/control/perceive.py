"""What a sighting says about the motion field and about who moves."""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool

from geoskill.control.action import Action
from geoskill.control.estimated_motion import EstimatedMotion
from geoskill.control.exploration import probe_of
from geoskill.control.image_motion import ImageMotion, Points
from geoskill.control.rows import Constraint
from geoskill.control.safety import FAR_PX
from geoskill.control.state import Followed, Mode, ServoState, Setup, Sighting
from geoskill.control.who_moves import RESTS, UNKNOWN, Ledger

MIN_FEATURES = 2
"""Of the carried thing, from which a field can be estimated."""
MIN_TOGETHER = 6
"""Carried features from which on those are left out that do not move together with the others."""
TOGETHER_PX = 1.5


def perceived(setup: Setup, state: ServoState, sighting: Sighting) -> ServoState:
    """Return the state with fields and ledgers as of this picture.

    Without knowing what was carried out, or while holding, nothing is learned.
    """
    acted = sighting.acted
    if acted is None or not np.isfinite(acted).all() or not sighting.followed:
        return state
    motions, ledgers = list(state.motions), list(state.ledgers)
    for camera, followed in enumerate(sighting.followed):
        followed = _finite(followed)
        if sighting.motions is not None:
            motion: ImageMotion = sighting.motions[camera]
            ledgers[camera] = ledgers[camera].advanced(motion, followed.before, followed.after, acted)
        elif state.probing:
            motions[camera], ledgers[camera] = _explored(
                setup, motions[camera], ledgers[camera], followed, acted, camera
            )
        elif (known := motions[camera]) is not None:
            ledgers[camera] = ledgers[camera].advanced(known, followed.before, followed.after, acted)
            if state.mode is not Mode.HOLD:
                carried = ledgers[camera].carried
                motions[camera] = known.observed(followed.before[carried], followed.after[carried], acted)
    return replace(state, motions=tuple(motions), ledgers=tuple(ledgers))


def _explored(
    setup: Setup, motion: ImageMotion | None, ledger: Ledger, followed: Followed, acted: Action, camera: int
) -> tuple[ImageMotion | None, Ledger]:
    """Return field and ledger of a camera after a probing move."""
    ledger = ledger.explored(followed.before, followed.after)
    ledger = ledger.without(ledger.carried & ~moves_together(followed.before, followed.after, ledger.carried))
    carried = ledger.carried
    if carried.sum() < MIN_FEATURES:
        return motion, ledger
    before, after = followed.before[carried], followed.after[carried]
    if motion is None:
        height = setup.sizes[camera][1]
        motion = EstimatedMotion.prior(setup.space, probe_of(setup.space), np.median(before, axis=0), height)
    return motion.observed(before, after, acted), ledger


def moves_together(before: Points, after: Points, carried: Bool[np.ndarray, " m"]) -> Bool[np.ndarray, " m"]:
    """Return which features moved as most of the carried ones did: by one affine map of the picture.

    Shadows move, too, and so do the fingers, nearer to the camera; with them, the field's affine part was wrong by
    several times its size.

    Args:
        before: in the last picture, pixels.
        after: in this one.
        carried: those that count; all of them are returned when they are few.
    """
    if carried.sum() < MIN_TOGETHER:
        return carried
    found = cv2.estimateAffine2D(
        before[carried].astype(np.float64),
        after[carried].astype(np.float64),
        method=cv2.RANSAC,
        ransacReprojThreshold=TOGETHER_PX,
        maxIters=500,
    )[1]
    together = carried.copy()
    together[carried] = np.asarray(found).ravel() > 0
    return together if together.sum() >= MIN_TOGETHER else carried


def _finite(followed: Followed) -> Followed:
    both = np.abs(np.concatenate([followed.before, followed.after], axis=1))
    kept = (both < FAR_PX).all(axis=1)  # which what is no number is not
    return Followed(followed.before[kept], followed.after[kept])


def with_roles(constraints: Sequence[Constraint], ledgers: Sequence[Ledger]) -> list[Constraint]:
    """Return the constraints with carried nodes as they were seen to move; those without one of each are left out.

    Where nothing is known of a node, what the skill learned holds.
    """
    kept = []
    for camera, ledger in enumerate(ledgers):
        own = [constraint for constraint in constraints if constraint.camera == camera]
        verdicts = iter(ledger.verdicts_on([node for constraint in own for node in constraint.nodes]))
        for constraint in own:
            carried = tuple(
                prior if verdict == UNKNOWN else verdict != RESTS
                for prior, verdict in zip(constraint.carried, verdicts, strict=False)
            )
            if any(carried) and not all(carried):
                kept.append(replace(constraint, carried=carried))
    return kept
