"""The frames that a command works on, with their ground truth: a video, or a simulated recording."""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, final

import numpy as np
from jaxtyping import Float32

from geoskill.cli.parts import parts_of
from geoskill.cli.progress import show_stage
from geoskill.cli.schemas import RegionsConfig, SimulatedTaskConfig, TrainCommandConfig
from geoskill.cli.scoring import load_labels
from geoskill.errors import InputError
from geoskill.evaluation.labels import Labels
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.io.disk_cache import DiskCache
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.image_folder import ImageFolder
from geoskill.io.sources import read_all
from geoskill.plugins import TASKS, code_identity
from geoskill.skill.checkpoint import SimulatedScene

if TYPE_CHECKING:
    from geoskill.simulation.recording import Recording

DEMONSTRATION = "demonstration"


@final
@dataclass(frozen=True, eq=False)
class LabeledSequence:
    """Frames with what is known of them.

    Attributes:
        source: where they come from.
        frames: all of them.
        labels: the ground truth, or None.
        recording: all that is known of it, if it is simulated.
    """

    source: FrameSource
    frames: Sequence[Frame]
    labels: Labels | None
    recording: "Recording | None" = None


@final
class RecordingSource(FrameSource):
    """The frames of a simulated recording.

    Args:
        recording: the recording.
        name: as it is called in messages.
        depth: the sensor that measures depth beside the pictures, or ``off``.
        seed: of the recording, for the noise of the sensor.
        episode: name of the recording, likewise.
    """

    def __init__(
        self, recording: "Recording", name: str, *, depth: str = "off", seed: int = 0, episode: str = ""
    ) -> None:
        self._recording = recording
        self._name = name
        self._depth = depth
        self._seed, self._episode = seed, episode

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return self._name

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        from geoskill.simulation.recording import FRAME_RATE

        return FRAME_RATE

    def __iter__(self) -> Iterator[Frame]:
        for index in range(len(self._recording)):
            yield self.frame(index)

    def frame(self, index: int) -> Frame:
        """Return one of the frames."""
        return Frame(index, index / self.frame_rate, self._recording.picture(index), *self._sensed(index))

    def _sensed(self, index: int) -> "tuple[()] | tuple[Float32[np.ndarray, 'height width'], DepthCamera]":
        """Return the depth of a frame with its intrinsics, or nothing without a sensor."""
        from geoskill.simulation.depth_sensor import NOISE_PER_M, depth_camera, recorded_depth

        if self._depth == "off":
            return ()
        camera = depth_camera(self._recording.intrinsics, NOISE_PER_M[self._depth])
        return recorded_depth(self._recording, index, self._depth, self._seed, self._episode), camera


def labeled_demonstrations(config: TrainCommandConfig, store: DiskCache | None) -> Iterator[LabeledSequence]:
    """Read the demonstrations of a training, one after the other; all but the first without ground truth.

    Args:
        config: has the task and, for simulated ones, scenario and seed.
        store: where recordings are kept.

    Raises:
        InputError: as :func:`labeled_video` and :func:`labeled_recording`; at once when one of several videos cannot be
            opened.
    """
    task = config.task
    if isinstance(task, SimulatedTaskConfig):
        episodes = [DEMONSTRATION, *(f"{DEMONSTRATION} {number}" for number in range(2, task.num_demonstrations + 1))]
        scene = SimulatedScene(task.name, config.seed, config.scenario)
        return (labeled_recording(scene, episode, store, task.depth) for episode in episodes)
    parts = parts_of(task)
    if task.regions.path is not None and parts and not parts[0].is_whole:
        raise InputError(
            f"task.regions={task.regions.path}: numbers the frames of the whole recording; expected none with"
            " task.start, task.end or task.stride"
        )
    sources = [part.open(task.frame_rate, strict_video=task.strict_video) for part in parts]
    regions = [task.regions] + [RegionsConfig()] * (len(parts) - 1)
    minimum = config.demonstration.gap + 1
    return (
        labeled_video(source, own_regions, task.every, minimum=minimum)
        for source, own_regions in zip(sources, regions, strict=True)
    )


def labeled_video(source: FrameSource, regions: RegionsConfig, every: int, minimum: int) -> LabeledSequence:
    """Read a video with its labeled regions.

    Args:
        source: the video.
        regions: where its labeled regions are, if it has some.
        every: every so many frames are to be evaluated.
        minimum: how many frames it needs.

    Raises:
        InputError: when it cannot be read, has too few frames, or the regions do not fit.
    """
    frames = read_all(source, minimum=minimum)
    stems = source.stems if isinstance(source, ImageFolder) else None
    labels = None if regions.path is None else load_labels(regions, frames, every, stems)
    return LabeledSequence(source, frames, labels)


def labeled_recording(
    scene: SimulatedScene, episode: str, store: DiskCache | None, depth: str = "off"
) -> LabeledSequence:
    """Return a recording with its ground truth, rendered unless the store has it.

    Args:
        scene: what it shows.
        episode: name of the recording; other episodes have other places and paths.
        store: where recordings are kept.
        depth: the sensor that measures depth beside the pictures, or ``off``.

    Raises:
        InputError: when there is no such task, or no OpenGL context.
    """
    from geoskill.evaluation.simulated import SimulatedLabels

    recording = simulated_recording(scene, episode, store)
    name = f"{scene.task}, {episode}"
    source = RecordingSource(recording, name, depth=depth, seed=scene.seed, episode=episode)
    return LabeledSequence(source, list(source), SimulatedLabels(recording, name), recording)


def simulated_recording(scene: SimulatedScene, episode: str, store: DiskCache | None) -> "Recording":
    """Return a recording, rendered unless the store has it; see :func:`labeled_recording`."""
    from geoskill.simulation.recording import Recording, pack, unpack
    from geoskill.simulation.scene import RecordingSettings, record

    task = TASKS.build(scene.task, {})()
    settings = RecordingSettings(task, scene.scenario, scene.seed, episode)

    def render() -> Recording:
        show_stage(f"rendering {scene.task}, {episode}")
        return record(settings)

    if store is None:
        return render()
    code = _renderer_identity() + code_identity(type(task))
    described = f"{code} {scene.task} {sorted(asdict(scene.scenario).items())} {scene.seed} {episode}"
    return store.get_or_compute(hashlib.sha256(described.encode()).hexdigest(), render, pack, unpack)


def _renderer_identity() -> str:
    """Return a digest of the code that makes recordings."""
    import mujoco

    import geoskill.simulation
    from geoskill.geometry import camera, poses

    digest = hashlib.sha256(mujoco.__version__.encode())
    simulation = sorted(Path(geoskill.simulation.__path__[0]).rglob("*.py"))
    for file in (*simulation, Path(camera.__file__), Path(poses.__file__)):
        digest.update(file.read_bytes())
    return digest.hexdigest()
