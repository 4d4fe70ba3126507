"""What several tests of the control room use."""

import numpy as np

from geoskill.control.action import ActionSpace, action_space
from geoskill.control.points_plant import FAULTS, Faults, PointsPlant, points_cameras
from geoskill.control.rows import Constraint
from geoskill.control.settings import ServoConfig
from geoskill.control.state import Setup, limits_of
from geoskill.control.trial import TrialResult, run_trial
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.par import Parallel

P2P, P2L, L2L, PAR = PointToPoint(), PointToLine(), LineToLine(), Parallel()
KERNELS = (P2P, P2L, L2L, PAR)


def pair(moving: tuple[float, float], resting: tuple[float, float], **fields: object) -> Constraint:
    """A p2p constraint of two pixels, the first carried."""
    nodes = (np.array(moving, np.float64), np.array(resting, np.float64))
    return Constraint(P2P, nodes, (True, False), **fields)  # type: ignore[arg-type]


def setup_of(dof: str = "descent", cameras: int = 1, **settings: float) -> Setup:
    config = ServoConfig(**settings)  # type: ignore[arg-type]
    space: ActionSpace = action_space(dof, limits_of(config))
    return Setup(space, config, ((640, 480),) * cameras, guarded=dof == "descent")


def trials(
    kernels: list[Kernel], faults: str | Faults, count: int, *, dof: str = "descent", cameras: int = 1, seed: int = 7
) -> list[TrialResult]:
    setup = setup_of(dof, cameras)
    results = []
    for trial in range(count):
        plant = PointsPlant(
            np.random.default_rng([seed, trial]),
            setup.space,
            points_cameras(cameras),
            kernels,
            FAULTS[faults] if isinstance(faults, str) else faults,
            has_support=setup.guarded,
        )
        results.append(run_trial(setup, plant))
    return results
