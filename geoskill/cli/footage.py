"""The frames that a command works on, and their ground truth where there is one: a video, or a simulated recording."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from hydra.utils import instantiate
from omegaconf import DictConfig, ListConfig

from geoskill.cli.inputs import open_recording
from geoskill.cli.scoring import load_labels
from geoskill.errors import InputError
from geoskill.evaluation.labels import Labels
from geoskill.io.disk_cache import DiskCache
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.sources import read_all

if TYPE_CHECKING:
    from geoskill.simulation.conditions import Conditions
    from geoskill.simulation.recording import Recording
    from geoskill.simulation.tasks.task import Task

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
    """

    def __init__(self, recording: "Recording", name: str) -> None:
        self._recording = recording
        self._name = name

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
            yield Frame(index, index / self.frame_rate, self._recording.picture(index))


def demonstrations(cfg: DictConfig, store: DiskCache | None) -> Iterator[LabeledSequence]:
    """What a skill is to be learned from, one after the other; all but the first without ground truth.

    Args:
        cfg: has ``demonstration.gap`` and a ``task`` with the ``path`` of a video or a list of them; or a simulated one
            with ``takes``, a ``scenario`` and a ``seed``.
        store: where recordings are kept.

    Raises:
        InputError: as :func:`video_footage` and :func:`simulated_footage`; at once when one of several videos cannot be
            opened.
    """
    if "scene" in cfg.task:
        takes = [DEMONSTRATION, *(f"{DEMONSTRATION} {number}" for number in range(2, cfg.task.takes + 1))]
        return (simulated_footage(cfg.task, cfg.scenario, cfg.seed, take, store) for take in takes)
    paths = list(cfg.task.path) if isinstance(cfg.task.path, ListConfig) else [cfg.task.path]
    sources = []
    for path in paths:
        if not isinstance(path, str | int):
            raise InputError(f"task.path: {path} is no path; expected a folder of images or a video file")
        sources.append(open_recording(path, cfg.task.frame_rate))
    regions = [cfg.task.regions] + [None] * (len(paths) - 1)
    return (
        video_footage(source, of_source, cfg.task.every, minimum=cfg.demonstration.gap + 1)
        for source, of_source in zip(sources, regions, strict=True)
    )


def video_footage(source: FrameSource, regions: object, every: int, minimum: int) -> LabeledSequence:
    """A video with its labeled regions.

    Args:
        source: the video.
        regions: path of the labeled regions, or None.
        every: of which frames every so many is to be judged.
        minimum: how many frames it needs.

    Raises:
        InputError: when it cannot be read, has too few frames, or the regions do not fit.
    """
    frames = read_all(source, minimum=minimum)
    labels = None if regions is None else load_labels(str(regions), frames, every)
    return LabeledSequence(source, frames, labels)


def simulated_footage(
    task: DictConfig, scenario: DictConfig, seed: int, take: str, store: DiskCache | None
) -> LabeledSequence:
    """A recording, rendered unless the store has it.

    Args:
        task: has the ``scene``.
        scenario: the conditions.
        seed: of the things' looks.
        take: name of the recording; other takes have other places and paths.
        store: where recordings are kept.

    Raises:
        InputError: when the settings cannot be, or there is no OpenGL context.
    """
    from geoskill.cli.settings import refusing
    from geoskill.evaluation.simulated import SimulatedLabels

    with refusing("task"):
        scene = instantiate(task.scene)
    with refusing("scenario"):
        conditions = instantiate(scenario)
    name, recording = _named_recording(scene, conditions, seed, take, store)
    source = RecordingSource(recording, name)
    return LabeledSequence(source, list(source), SimulatedLabels(recording, name), recording)


def demonstration_recording(
    learned_from: Mapping[str, Any], task: DictConfig, choice: str, store: DiskCache | None
) -> "Recording | None":
    """The simulated demonstration that a skill learned from, or None if it did not learn this task in simulation.

    Args:
        learned_from: as the skill says it.
        task: has the ``scene``.
        choice: the task's name.
        store: where recordings are kept.

    Raises:
        InputError: as :func:`simulated_footage`, and when what the skill says of its demonstration is no such thing.
    """
    from geoskill.cli.settings import refusing

    if learned_from.get("task") != choice or "scenario" not in learned_from:
        return None
    with refusing("task"):
        scene = instantiate(task.scene)
    conditions, seed = stored_conditions(learned_from["scenario"]), stored_seed(learned_from)
    # Without its pictures, of which few are wanted.
    return _named_recording(scene, conditions, seed, DEMONSTRATION, store)[1]


def stored_seed(learned_from: Mapping[str, Any]) -> int:
    """The seed of the simulated demonstration that a checkpoint names; 0 if it names none.

    Raises:
        InputError: when it is no whole number.
    """
    seed = learned_from.get("seed", 0)
    if type(seed) is not int:
        raise InputError(f"the skill's learned_from.seed is {seed!r}; expected a whole number")
    return seed


def stored_conditions(scenario: object) -> "Conditions":
    """The conditions that a checkpoint names: plain values into named fields, for a checkpoint may be a negative's.

    Raises:
        InputError: for anything else.
    """
    from geoskill.simulation.conditions import Conditions

    kinds: dict[str, type] = {field.name: field.type for field in fields(Conditions) if isinstance(field.type, type)}
    if not isinstance(scenario, Mapping):
        raise InputError(f"the skill's learned_from.scenario is {scenario!r}; expected names with values")
    for name, value in scenario.items():
        if name not in kinds:
            raise InputError(f"the skill's learned_from.scenario has {name!r}; expected some of {', '.join(kinds)}")
        if type(value) is not kinds[name]:
            raise InputError(
                f"the skill's learned_from.scenario.{name} is {value!r}; expected a {kinds[name].__name__}"
            )
    if "actor" not in scenario:
        raise InputError("the skill's learned_from.scenario has no actor; expected one")
    return Conditions(**scenario)


def _named_recording(
    scene: "Task", conditions: "Conditions", seed: int, take: str, store: DiskCache | None
) -> tuple[str, "Recording"]:
    """What a recording is called in messages, and itself; see :func:`simulated_footage`."""
    from geoskill.simulation.recording import Recording, pack, unpack
    from geoskill.simulation.scene import RecordingSettings, record

    settings = RecordingSettings(scene, conditions, seed, take)
    name = f"{scene.name}, {take}"

    def render() -> Recording:
        return record(settings)

    if store is None:
        return name, render()
    described = f"{_renderer_identity()} {scene.name} {sorted(asdict(conditions).items())} {seed} {take}"
    key = hashlib.sha256(described.encode()).hexdigest()
    return name, store.get_or_compute(key, render, pack, unpack)


def _renderer_identity() -> str:
    """What recordings of the same settings depend on: the code that makes them."""
    import mujoco

    import geoskill.simulation
    from geoskill.geometry import camera, poses

    digest = hashlib.sha256(mujoco.__version__.encode())
    simulation = sorted(Path(geoskill.simulation.__path__[0]).rglob("*.py"))
    for file in (*simulation, Path(camera.__file__), Path(poses.__file__)):
        digest.update(file.read_bytes())
    return digest.hexdigest()
