"""The guarded way down, straight down onto the goal.

Above its goal by h, a thing whose picture lies on the goal's is nearer to the camera by h cos / sin of the line of
sight: whoever drives x and y by the picture alone comes down along that line, and onto whatever is in front of the
goal. So the height that is left is estimated, too: from the picture's scale, which says it roughly (to 5 to 10 mm), and
ever better on the way down. x and y are driven to where the picture is to be at this height.

What stops the thing far above its goal is not its support: pressed lightly, it slides to and fro along the line of
sight until it goes on down.
"""

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np

from geoskill.control.action import Action, ActionSpace, Dof
from geoskill.control.law import Height
from geoskill.control.settings import ServoConfig

MEMORY: Final = 0.8
"""Weight of the earlier frames in the estimate of the height: about five frames count."""
TRUSTED_STD_M: Final = 0.030
"""Standard deviation at which half of the height is believed."""
FULL_SPEED_PX: Final = 4.0
"""RMS of the errors below which the way down has its full speed; above, less in proportion."""
SUPPORT_M: Final = 0.008
SUPPORT_STDS: Final = (1.5, 3.0)
"""What stops the thing is its support when no more than either is left: less than the first number at once, less than
the second one when it found no way down."""
PRESS_M: Final = 0.001
"""Step down onto what stops the thing."""
SWEEP_M: Final = 0.002
"""Change of the height that is aimed at, by which the thing slides, in one step."""
SWEEP_FRAMES: Final = (27, 45, 54)
"""Steps farther away, then nearer, and back again."""


@final
@dataclass(frozen=True)
class Descent:
    """What is remembered of the way down.

    Attributes:
        bottom_m: estimated displacement along z from the start to the goal, meters.
        weight: of the estimate, 1 / m².
        swept: steps for which the thing slid on something that is not its support.
        landed: whether the support was found: nothing is left then, whatever the picture says.
    """

    bottom_m: float = 0.0
    weight: float = 0.0
    swept: int = 0
    landed: bool = False

    def seen(self, travelled_m: float, height: Height) -> "Descent":
        """Return the descent after a frame.

        Args:
            travelled_m: displacement along z since the start.
            height: displacement along z that the picture asks for.
        """
        if not (np.isfinite(height.std_m) and height.std_m > 0 and np.isfinite(height.left_m)):
            return self
        own, old = height.std_m**-2, MEMORY * self.weight
        bottom = (old * self.bottom_m + own * (travelled_m + height.left_m)) / (old + own)
        return replace(self, bottom_m=bottom, weight=old + own)

    @property
    def std_m(self) -> float:
        """Standard deviation of the height, as one frame has it: what pairs miss each other by is not averaged."""
        return float("inf") if self.weight == 0 else float(((1 - MEMORY) * self.weight) ** -0.5)

    def ahead_m(self, travelled_m: float, room_m: float) -> float:
        """Return the displacement along z that is still to come, as far as it is believed; never up.

        Args:
            travelled_m: displacement along z since the start.
            room_m: way down that the limits leave.
        """
        if self.landed:
            return 0.0
        left = min(self.bottom_m - travelled_m, 0.0) / (1 + (self.std_m / TRUSTED_STD_M) ** 2)
        return -min(max(self._sweep_m - left, 0.0), room_m)

    @property
    def _sweep_m(self) -> float:
        out, back, home = SWEEP_FRAMES
        return float(np.interp(self.swept, (0, out, back, home), np.array([0, out, 2 * out - back, 0]) * SWEEP_M))

    def is_obstacle(self, travelled_m: float) -> bool:
        """Return whether what stops the thing cannot be its support."""
        left = travelled_m - self.bottom_m
        return not self.landed and left > max(SUPPORT_M, SUPPORT_STDS[self.is_stuck] * self.std_m)

    @property
    def is_stuck(self) -> bool:
        """Return whether the thing slid everywhere and found no way down."""
        return self.swept >= SWEEP_FRAMES[-1]


@final
@dataclass(frozen=True, eq=False)
class Guided:
    """What the way down asks for in one frame.

    Attributes:
        action: displacement, along z only.
        ahead: displacement that is still to come, along z only.
        drift: displacement against whose effect on the picture the other axes are to work in this step.
        at_support: whether the way down has ended.
    """

    action: Action
    ahead: Action
    drift: Action
    at_support: bool


def guided_down(
    config: ServoConfig, space: ActionSpace, descent: Descent, travelled: Action, rms: float, touched: bool
) -> tuple[Guided, Descent]:
    """Return what the way down asks for, and what is remembered of it.

    Args:
        config: of the loop.
        space: what is commanded, z among it.
        descent: so far.
        travelled: displacement since the start.
        rms: of the errors at this height, pixels.
        touched: whether something stops the thing.
    """
    z = space.dofs.index(Dof.Z)
    rest, now, step_m = np.zeros(len(space.dofs)), float(travelled[z]), float(space.step[z])
    room = max(now + space.limits.down_m, 0.0)
    obstacle = touched and descent.is_obstacle(now)
    if (touched and not obstacle) or room < 1e-9:
        return Guided(rest, rest, rest, True), replace(descent, landed=True)
    press = min(PRESS_M, config.descend_ratio * step_m)
    if obstacle:
        descent, down = replace(descent, swept=descent.swept + 1), -press
    elif descent.landed:
        down = -press
    elif rms < config.descend_below_px:
        down = -config.descend_ratio * step_m * min(1.0, FULL_SPEED_PX / max(rms, 1e-9))
    else:
        down = 0.0
    ahead = descent.ahead_m(now, room)
    change = down + descent.ahead_m(now + down, room) - ahead

    def along(meters: float) -> Action:
        action = rest.copy()
        action[z] = meters
        return action

    return Guided(along(down), along(ahead), along(change), False), descent
