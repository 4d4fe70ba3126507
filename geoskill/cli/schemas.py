"""The configuration of the commands: what they need beside the settings of learning, and the names of older keys."""

import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, final

from geoskill.config import (
    MAX_FRAME_RATE,
    MIN_FRAME_RATE,
    BilinearConfig,
    Config,
    Learning,
    MessagePassingConfig,
    PrototypesConfig,
    ScenarioConfig,
    SelectionConfig,
    TrainConfig,
)
from geoskill.control.settings import ServoConfig
from geoskill.plugins import EXTRACTORS
from geoskill.schema import WORDS, markdown_table, reference_table, setting


def _episode() -> Any:
    return setting(None, "Number of the episode in a LeRobot data set.", at_least=0)


def _camera() -> Any:
    return setting(None, "Camera in a LeRobot data set, such as `observation.images.front`; null: the only one.")


def _topic() -> Any:
    return setting(None, "Image topic of a bag of ROS 2 (MCAP); null: the only one.")


def _frame_rate() -> Any:
    return setting(
        None,
        "Frames per second; null: the video's own, 30 for a folder.",
        at_least=MIN_FRAME_RATE,
        at_most=MAX_FRAME_RATE,
    )


def _strict_video() -> Any:
    return setting(
        False,
        "Refuse a video with damaged or missing frames, or errors that its decoder makes up for; else they are said.",
    )


@final
@dataclass
class RegionsConfig(Config):
    """Labeled regions; `regions=PATH` is short for `regions.path=PATH`."""

    path: str | None = setting(
        None,
        "File of labeled regions: this project's JSON, or LabelMe's, COCO's or CVAT's; or a folder of LabelMe's files"
        " or of masks.",
    )
    object: str = setting("object", "What its labels call the moved object.")
    target: str = setting("target", "What its labels call what the object is brought to.")
    hand: str | None = setting(None, "What its labels call the hand or gripper; null: `hand`, if there is one.")


@final
@dataclass
class SimulatedTaskConfig(Config):
    """A simulated task."""

    name: str = setting("sorting", "Task.")
    every: int = setting(5, "A trained skill is scored on every so many frames.", at_least=1)
    num_demonstrations: int = setting(
        1, "Demonstrations to learn from, by other people, in other light; the first is shown and scored.", at_least=1
    )
    depth: str = setting(
        "off",
        "Depth beside the pictures: `off`, as a RealSense D435 or D405 would measure it, or `perfect`.",
        choices=("off", "d435", "d405", "perfect"),
    )


@final
@dataclass
class VideoTaskConfig(Config):
    """`task=video`: demonstrations of your own."""

    name: str = setting("video", "Task.")
    path: Any = setting(
        None,
        "A video file, a folder of images, a LeRobot data set or a bag of ROS 2; or several, [a.mp4,b.mp4], of which"
        " the first is shown and scored.",
    )
    episode: Any = setting(None, "Number of the episode in a LeRobot data set; or several, `[0,3]`, as of `path`.")
    camera: str | None = _camera()
    topic: str | None = _topic()
    start: Any = setting(
        None, "Where the demonstration begins: seconds (`2.5`) or frames (`75f`); several, `[0,10]`, as of `path`."
    )
    end: Any = setting(None, "Where it ends, in seconds or frames; the frame there is not taken.")
    stride: int = setting(1, "Of so many frames, one is taken.", at_least=1)
    frame_rate: float | None = _frame_rate()
    strict_video: bool = _strict_video()
    regions: RegionsConfig = field(default_factory=RegionsConfig)
    every: int = setting(5, "A trained skill is scored on every so many frames.", at_least=1)


@final
@dataclass
class WandbConfig(Config):
    """`logger=wandb`: Weights & Biases."""

    project: str = setting("geoskill", "Project.")
    entity: str | None = setting(None, "Team or user; null: the default of the login.")
    offline: bool = setting(True, "Keep the run on this machine; false uploads it.")


@final
@dataclass
class CacheConfig(Config):
    """Cache of extracted features and rendered recordings."""

    enabled: bool = setting(True, "Keep extracted features and rendered recordings between runs.")
    folder: str | None = setting(None, "Folder; null: the user's cache folder.")
    limit_mb: float = setting(2000.0, "Megabytes that the folder may hold.", above=0)


RERUN = "`true`: write recording.rrd for rerun; `live`: show it in rerun's viewer meanwhile."
EXPORT = "`ros2`: error.mcap; `visp`: visp_features.json; `mvtb`: mvtb.npz; or several, `[ros2,visp]`."


def _debug() -> Any:
    return setting(False, "Show the traceback of an error.")


def _definition() -> Any:
    return setting(None, "File that is obeyed: an edited copy of the run's skill.yaml.")


def _report() -> Any:
    return setting(True, "Write report.html, a page about the run.")


def _precision() -> Any:
    return setting(None, "Precision of the messages; null: that of the training.", choices=("float32", "bfloat16"))


@final
@dataclass
class TrainCommandConfig(Learning):
    """`train.py`: learn a skill from a demonstration, or from several."""

    task: Any = setting(SimulatedTaskConfig, "What is demonstrated: `video`, or a simulated task.")
    scenario: ScenarioConfig = field(default_factory=ScenarioConfig)
    logger: Any = setting(dict, "Loggers beside metrics.csv: `wandb` or `none`.")
    cache: CacheConfig = field(default_factory=CacheConfig)
    ckpt_path: str | None = setting(
        None,
        "Checkpoint, or folder, of an interrupted run to go on with; `auto`: the one in this run's own folder, if any.",
    )
    init_from: str | None = setting(None, "Skill whose weights to start from, on another demonstration.")
    report: bool = _report()
    rerun: Any = setting(False, RERUN)
    debug: bool = _debug()

    def learning(self) -> TrainConfig:
        """Return the settings of learning alone."""
        return TrainConfig(**{own.name: getattr(self, own.name) for own in fields(TrainConfig)})


@final
@dataclass
class InferCommandConfig(Config):
    """`infer.py`: select associations on every frame of a video, a folder or a camera."""

    skill: str | None = setting(None, "RUN/skill.ckpt, a run folder, or wandb:ENTITY/PROJECT/NAME:ALIAS.")
    definition: str | None = _definition()
    video: Any = setting(
        None,
        "A video file, a folder of images, a LeRobot data set, a bag of ROS 2, the number of a camera, or a URL; or"
        " several, [a.mp4,b.mp4], or a folder of videos: a run for each, and one table.",
    )
    episode: int | None = _episode()
    camera: str | None = _camera()
    topic: str | None = _topic()
    frame_rate: float | None = _frame_rate()
    strict_video: bool = _strict_video()
    inference: SelectionConfig = field(default_factory=SelectionConfig)
    cache: CacheConfig = field(default_factory=CacheConfig)
    threads: int | None = setting(
        None, "Threads of PyTorch, and frames worked on at once; null: as many as PyTorch likes.", at_least=1
    )
    rerun: Any = setting(False, RERUN)
    export: Any = setting(None, f"Files for other programs. {EXPORT}")
    intrinsics: str | None = setting(
        None, "File of the camera's intrinsics, as OpenCV, ROS and TUM write it, for Jacobians in exports."
    )
    depth_m: float = setting(
        0.7,
        "Rough distance of the scene along the camera's axis, for exports of pictures without depth, meters.",
        above=0,
    )
    precision: str | None = _precision()
    device: str = setting("cpu", "Device of the networks.")
    report: bool = _report()
    debug: bool = _debug()


@final
@dataclass
class EvaluateCommandConfig(Config):
    """`evaluate.py`: score a skill on labeled frames, or on a simulated recording."""

    skill: str | None = setting(None, "RUN/skill.ckpt, a run folder, or wandb:ENTITY/PROJECT/NAME:ALIAS.")
    definition: str | None = _definition()
    video: Any = setting(None, "A labeled video file, folder of images, LeRobot data set or bag of ROS 2.")
    episode: int | None = _episode()
    camera: str | None = _camera()
    topic: str | None = _topic()
    regions: RegionsConfig = field(default_factory=RegionsConfig)
    frame_rate: float | None = _frame_rate()
    strict_video: bool = _strict_video()
    task: Any = setting(None, "A simulated task, instead of a video.")
    scenario: ScenarioConfig = field(default_factory=lambda: ScenarioConfig(actor="robot"))
    seed: int | None = setting(
        None, "Seed of the looks of simulated things; null: that of the demonstration.", at_least=0
    )
    every: int = setting(1, "Score every so many frames.", at_least=1)
    failures: int = setting(
        24, "Pictures of wrong frames that are written, evenly of all; 0: none.", at_least=0, at_most=10_000
    )
    threads: int | None = setting(
        None, "Threads of PyTorch, and frames worked on at once; null: as many as PyTorch likes.", at_least=1
    )
    inference: SelectionConfig = field(default_factory=lambda: SelectionConfig(abstain=0.0))
    cache: CacheConfig = field(default_factory=CacheConfig)
    precision: str | None = _precision()
    device: str = setting("cpu", "Device of the networks.")
    report: bool = _report()
    debug: bool = _debug()


@final
@dataclass
class ReproduceCommandConfig(Config):
    """`reproduce.py`: a table or figure of the paper, or another study, over several trainings."""

    artifact: Any = setting(
        None, "The study, one of those in conf/artifact; `artifact.data` is the folder of its sequences."
    )
    jobs: int = setting(2, "Trainings at once on this machine, each on one thread.", at_least=1)
    quick: bool = setting(False, "One seed, few epochs and every tenth frame: to see that it works, not what it finds.")
    job: int | None = setting(None, "Number of the one job that a launched process performs.", at_least=0)
    report: bool = _report()
    debug: bool = _debug()


@final
@dataclass
class ControllerConfig(Config):
    """Where the Jacobian of the picture comes from."""

    name: str = setting(
        "field",
        "`field`: estimated from what is seen to move; `calibrated`: from a known camera; `truth`: exact; `broyden`:"
        " the Jacobian of the error itself, the usual way.",
        choices=("field", "calibrated", "truth", "broyden"),
    )


@final
@dataclass
class PlantConfig(Config):
    """What is controlled."""

    name: str = setting(
        "points",
        "`points`: projected points with noise; `scene`: rendered pictures.",
        choices=("points", "scene"),
    )
    pairs: int = setting(8, "Associations of two points, of plant=points.", at_least=0, at_most=50)
    lines: int = setting(0, "Associations of two lines, of plant=points.", at_least=0, at_most=50)
    contact: bool = setting(
        True,
        "Of plant=scene: the way down ends by touch, and the thing is let go; false: at the goal's height by"
        " construction, which also does where nothing stops the thing, as in screw and folding.",
    )


@final
@dataclass
class ServoCommandConfig(Config):
    """`servo.py`: close the loop in simulation, and measure how well it ends."""

    skill: str | None = setting(None, "RUN/skill.ckpt or a run folder, for plant=scene.")
    task: Any = setting(lambda: SimulatedTaskConfig("insertion"), "Simulated task, for plant=scene.")
    scenario: ScenarioConfig = field(default_factory=lambda: ScenarioConfig(actor="robot"))
    controller: Any = setting(ControllerConfig, "Where the Jacobian comes from.")
    plant: Any = setting(PlantConfig, "What is controlled.")
    select: str = setting(
        "skill",
        "Of plant=scene: `skill`: its associations; `top`: the best one alone, until its error is zero, as in the"
        " paper; `truth`: detected pairs that meet at the goal by the ground truth; `tracked`: those of the first"
        " picture, followed by trackers.",
        choices=("skill", "top", "truth", "tracked"),
    )
    definition: str | None = _definition()
    phases: str = setting(
        "none",
        "Of plant=scene: `learned`: in the order in which members settled in the demonstration; `none`: all at once.",
        choices=("learned", "none"),
    )
    faults: str = setting(
        "none",
        "Faults of the selection, of plant=points: a switch in 15 % of the frames (`switches`), and 20 % wrong ones"
        " (`wrong`), and 20 % missed, 10 % of the frames lost, one frame late (`all`); pairs 3 mm apart (`apart`).",
        choices=("none", "switches", "wrong", "apart", "all", "all_apart"),
    )
    trials: int = setting(20, "Trials; those that are in the folder already are kept.", at_least=1)
    cameras: int = setting(1, "Cameras.", at_least=1, at_most=2)
    dof: str = setting(
        "descent",
        "`descent`: x, y and yaw by the picture, and a guarded way down; `xyzy`, `xyzabc`: all by the pictures.",
        choices=("descent", "xyzy", "xyzabc"),
    )
    seed: int = setting(0, "Seed of the trials: where things are, and every error.", at_least=0)
    servo: ServoConfig = field(default_factory=ServoConfig)
    cache: CacheConfig = field(default_factory=CacheConfig)
    device: str = setting("cpu", "Device of the networks.")
    debug: bool = _debug()


@final
@dataclass
class ServeCommandConfig(Config):
    """`serve.py`: tell other programs live what a skill selects, and how a robot has to move."""

    skill: str | None = setting(None, "RUN/skill.ckpt, a run folder, or wandb:ENTITY/PROJECT/NAME:ALIAS.")
    definition: str | None = _definition()
    video: Any = setting(
        None, "The number of a camera, a URL, or a recording that is played; null: pictures come with requests."
    )
    episode: int | None = _episode()
    camera: str | None = _camera()
    topic: str | None = _topic()
    frame_rate: float | None = _frame_rate()
    realtime: bool = setting(
        True, "Play a recording as fast as it was recorded, leaving frames out; false: every frame, as fast as it goes."
    )
    bind: str = setting(
        "tcp://127.0.0.1:5555", "Address of published messages; requests go to the next port. Only this computer's."
    )
    drive: bool = setting(False, "Close the loop: messages have the robot's next movement.")
    dof: str = setting(
        "descent",
        "`descent`: x, y and yaw by the picture, and a guarded way down; `xyzy`, `xyzabc`: all by the pictures.",
        choices=("descent", "xyzy", "xyzabc"),
    )
    cameras: int = setting(1, "Pictures in a request.", at_least=1, at_most=2)
    servo: ServoConfig = field(default_factory=ServoConfig)
    inference: SelectionConfig = field(default_factory=SelectionConfig)
    threads: int | None = setting(
        None, "Threads of PyTorch, and frames worked on at once; null: as many as PyTorch likes.", at_least=1
    )
    precision: str | None = _precision()
    device: str = setting("cpu", "Device of the networks.")
    debug: bool = _debug()


COMMANDS: Mapping[str, type[Config]] = {
    "train": TrainCommandConfig,
    "infer": InferCommandConfig,
    "evaluate": EvaluateCommandConfig,
    "reproduce": ReproduceCommandConfig,
    "servo": ServoCommandConfig,
    "serve": ServeCommandConfig,
}

RENAMED: Mapping[str, str] = {
    "demonstration.horizon": "demonstration.max_span_ratio",
    "demonstration.strangers": "demonstration.num_negatives",
    "demonstration.visible_features": "demonstration.max_visible_features",
    "features.colour": "features.color",
    "inference.alternatives": "inference.top_k",
    "inference.minimum_weight": "inference.min_drawn_weight",
    "minimum_weight": "inference.min_drawn_weight",
    "objective.alternatives": "objective.top_k",
    "objective.first_samples": "objective.value_samples",
    "objective.second_samples": "objective.gradient_samples",
    "optimizer._target_": "optimizer.name",
    "task.takes": "task.num_demonstrations",
    "weight_averaging": "ema_decay",
}
"""Keys of earlier versions with their present names."""


def markdown_reference() -> str:
    """Return the reference of all settings as Markdown, one table per command and per choice of a group."""
    sections = [*COMMANDS.items()]
    choices: Sequence[tuple[str, type[Config], str]] = (
        ("model=message_passing", MessagePassingConfig, "model."),
        ("model=bilinear", BilinearConfig, "model."),
        ("model=prototypes", PrototypesConfig, "model."),
        ("task=sorting, insertion, folding, screw, flush, ring", SimulatedTaskConfig, "task."),
        ("task=video", VideoTaskConfig, "task."),
        ("logger=wandb", WandbConfig, "logger.wandb."),
    )
    tables = [f"## {name}.py\n\n{schema.__doc__}\n\n{markdown_table(schema)}" for name, schema in sections]
    tables += [f"## {name}\n\n{schema.__doc__}\n\n{markdown_table(schema, key)}" for name, schema, key in choices]
    return "\n".join([*tables, *(_descriptor_reference(name) for name in EXTRACTORS.built_in)])


def _descriptor_reference(name: str) -> str:
    documentation = inspect.getdoc(EXTRACTORS.get(name)) or ""
    rows = []
    for key, parameter in EXTRACTORS.parameters(name).items():
        expected = WORDS.get(type(parameter.default), "a value")
        # An entry of the docstring's arguments goes on where lines are indented further.
        entry = re.search(rf"^    {key}: (.*(?:\n     .*)*)", documentation, re.MULTILINE)
        meaning = " ".join(entry[1].split()) if entry else ""
        rows.append((f"descriptor.{name}.{key}", parameter.default, expected, meaning))
    return f"## descriptor={name}\n\n{reference_table(rows)}"
