"""From a task and conditions to a recording."""

from dataclasses import dataclass
from typing import final

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.simulation.recording import Recording, join
from geoskill.simulation.stage import Stage
from geoskill.simulation.tasks.task import Task


@final
@dataclass(frozen=True)
class RecordingSettings:
    """Settings of a recording; equal settings give equal recordings.

    Attributes:
        task: the task to perform.
        scenario: who performs it, and which difficulties there are.
        seed: of the appearance of things: prints and colors.
        episode: name of the recording, which seeds everything else, such as placements, path and speed.
        stride: every ``stride``-th frame and the last one are rendered; things move on all of them.

    Raises:
        InputError: when ``seed`` is negative.
        ValueError: when ``stride`` is not positive.
    """

    task: Task
    scenario: ScenarioConfig
    seed: int
    episode: str
    stride: int = 1

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"seed={self.seed}: expected 0 or more for a simulated task")
        if self.stride < 1:
            raise ValueError(f"stride={self.stride}: expected at least 1")


def record(settings: RecordingSettings) -> Recording:
    """Render a recording.

    Raises:
        InputError: when no OpenGL context is available.
    """
    shots = []
    with Stage(settings.task, settings.scenario, settings.seed, settings.episode) as stage:
        motion = stage.motion
        for frame in range(len(stage)):
            stage.surround(frame)
            held, opening, retreat_m = bool(motion.held[frame]), motion.opening[frame], motion.retreat_m[frame]
            stage.lead(motion.object_poses[frame], held, float(opening), float(retreat_m))
            if frame % settings.stride == 0 or frame == len(stage) - 1:
                shots.append(stage.shot())
    return join(shots)
