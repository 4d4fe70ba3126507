"""The configuration: every setting with its type, default, range and meaning.

The dataclasses are arguments of :func:`geoskill.learn`, schema of the command line (:mod:`geoskill.cli.schemas` adds
what only commands need), and the source of ``docs/usage/configuration``. The files in ``conf/`` only say which class is
chosen and what differs from these defaults.
"""

from abc import ABC
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

from geoskill.schema import Config as Config
from geoskill.schema import setting
from geoskill.tuning import NegativesConfig, TemporalFilterConfig, TrajectoryConfig

MAX_TOP_K = 1000
AUTO = "auto"
# A picture in a hundred seconds; a high-speed camera. Encoders take no others.
MIN_FRAME_RATE, MAX_FRAME_RATE = 0.01, 10_000.0


@final
@dataclass
class FeaturesConfig(Config):
    """Features of a frame."""

    max_features: int = setting(60, "Features per frame and descriptor, strongest first.", at_least=2, at_most=5000)
    min_side: int = setting(
        480,
        "Pictures with a shorter side of fewer pixels are enlarged to it before extraction, strips to less; 0: never.",
        at_least=0,
        at_most=1080,
    )
    max_side: int = setting(
        720,
        "Pictures with a shorter side of more pixels are reduced to it before extraction; 0: never.",
        at_least=0,
    )
    color: float = setting(
        8.0,
        "Weight of the colors around a point beside its descriptor; 0: the gray descriptor alone.",
        at_least=0,
        at_most=1000,
    )


@final
@dataclass
class DemonstrationConfig(Config):
    """Transitions of a demonstration, and how training disturbs them."""

    gap: int = setting(2, "Frames of the shortest transition.", at_least=1)
    max_span_ratio: float = setting(
        0.65,
        "Longest transition as a share of the demonstration; 0: transitions of `gap` frames only.",
        at_least=0,
        at_most=1,
    )
    batch_size: int = setting(8, "Transitions per step and process.", at_least=1)
    descriptor_noise: float = setting(
        0.15, "Expected norm of the noise on a descriptor over the norm of the descriptor.", at_least=0
    )
    feature_dropout: float = setting(
        0.5, "Probability with which a feature is hidden in a step, as if it were occluded.", at_least=0, below=1
    )
    max_visible_features: int | None = setting(
        50, "Features of each type that take part in a step, on average, at most; null: all.", at_least=2
    )
    num_negatives: int = setting(
        40, "Synthetic negative features added to each frame in training; their associations earn nothing.", at_least=0
    )
    use_places: bool = setting(
        True,
        "Where the first and the last pictures show from where to where something was carried, learn from that, too;"
        " the camera must be at rest.",
    )
    negatives: NegativesConfig = field(default_factory=NegativesConfig)
    trajectory: TrajectoryConfig = field(default_factory=TrajectoryConfig)


@final
@dataclass
class ObjectiveConfig(Config):
    """The InMaxEnt objective and its additions."""

    sigma0: float = setting(
        0.55, "Standard deviation of the expert's rewards, the paper's human factor.", at_least=1e-3, at_most=1e3
    )
    rsw_weight: float = setting(0.1, "Lambda, the weight of the residual sum of weights.", at_least=0)
    top_k: int = setting(10, "p, the number of instances of a frame that may share the weight.", at_least=1)
    reward: str = setting(
        "tracked",
        "`tracked`: change of each instance's own error; `frame`: the paper's change of Ec between frames.",
        choices=("tracked", "frame"),
    )
    change: str = setting(
        "relative",
        "`relative`: change of error over the sum of both errors; `absolute`: the paper's, in pixels.",
        choices=("relative", "absolute"),
    )
    error_reduction: str = setting(
        "norm",
        "`norm`: Ec is the sum of g times norm(E); `vector`: the paper's norm of the sum.",
        choices=("norm", "vector"),
    )
    partition: str = setting(
        "exact",
        "`exact`: log Z in closed form; `monte_carlo`: the paper's estimate.",
        choices=("exact", "monte_carlo"),
    )
    value_samples: int = setting(1000, "s1, samples for the value of the Monte-Carlo estimate.", at_least=1)
    gradient_samples: int = setting(1000, "s2, samples for its gradient.", at_least=1)
    beta_scale: float = setting(
        1.5, "c of design choice 12: the median moving instance earns tanh(beta_scale / 2).", above=0
    )
    goal_weight: float = setting(
        1.0, "Weight of the divergence from what has come together in the end; 0: the paper's objective.", at_least=0
    )
    goal_temperature: float = setting(
        0.1, "Goal progress by which an instance may fall behind the best and count a third as much.", above=0
    )
    goal_scale: float = setting(200.0, "Margin between two scores over the margin of their goal progress.", above=0)


@final
@dataclass
class OptimizerConfig(Config):
    """The optimizer, one of `torch.optim`."""

    name: str = setting("adam", "Optimizer.", choices=("adam", "adamw", "sgd"))
    lr: float = setting(3e-3, "Learning rate.", above=0)
    weight_decay: float = setting(0.0, "Weight decay.", at_least=0)


@final
@dataclass
class TrainerConfig(Config):
    """The Lightning trainer."""

    accelerator: str = setting("cpu", "Device type.", choices=("cpu", "gpu", "cuda", "mps", "auto"))
    devices: int = setting(1, "Processes, each with a device of its own.", at_least=1)
    strategy: str = setting("auto", "Lightning strategy, such as `ddp`.")
    precision: str = setting("32-true", "Lightning precision, such as `bf16-mixed`.")
    max_epochs: int = setting(16, "Epochs.", at_least=1)
    limit_train_batches: int | float | None = setting(
        25, "Steps of an epoch; a fraction is a share of all transitions; null: all of them.", above=0
    )
    gradient_clip_val: float | None = setting(1.0, "Limit of each member's gradient; null: none.", above=0)
    gradient_clip_algorithm: str = setting(
        "norm", "`norm`: of the whole gradient; `value`: of each component.", choices=("norm", "value")
    )
    log_every_n_steps: int = setting(1, "Steps between two entries of a logger.", at_least=1)
    enable_progress_bar: bool = setting(True, "Show a progress bar on a terminal.")


@final
@dataclass
class EarlyStoppingConfig(Config):
    """Stopping before the last epoch."""

    patience: int | None = setting(
        None, "Epochs without progress of the objective after which to stop; null: never stop early.", at_least=0
    )
    min_delta: float = setting(0.002, "Smallest increase that counts as progress.", at_least=0)


def _min_drawn_weight() -> Any:
    return setting(0.1, "Select-out below which associations other than the best are not drawn.", at_least=0, at_most=1)


def _temporal() -> Any:
    return setting(
        "filter",
        "`filter`: a selection stays until another is better for a while; `none`: each frame by itself.",
        choices=("none", "filter"),
    )


def _abstain() -> Any:
    return setting(
        0.2,
        "Confidence of the selected association below which nothing is selected; 0: always select.",
        at_least=0,
        at_most=1,
    )


@final
@dataclass
class SelectionConfig(Config):
    """Selection of associations with a learned skill."""

    min_drawn_weight: float = _min_drawn_weight()
    temporal: str = _temporal()
    abstain: float = _abstain()
    filter: TemporalFilterConfig = field(default_factory=TemporalFilterConfig)


@final
@dataclass
class InferenceConfig(Config):
    """Selection of associations, as a training writes it into the skill and shows it."""

    top_k: int = setting(10, "Associations listed per frame and member.", at_least=1, at_most=MAX_TOP_K)
    min_drawn_weight: float = _min_drawn_weight()
    temporal: str = _temporal()
    abstain: float = _abstain()
    filter: TemporalFilterConfig = field(default_factory=TemporalFilterConfig)


@final
@dataclass
class MessagePassingConfig(Config):
    """`model=message_passing`: the paper's network; the presets are `model=default` and `model=paper`."""

    name: str = setting("message_passing", "Network.")
    hidden_dim: int = setting(32, "h, length of a node's state.", at_least=1, at_most=4096)
    layers: int = setting(3, "T, steps of message passing.", at_least=1, at_most=64)
    shared_weights: bool = setting(True, "One set of weights for all steps.")
    encoder_dim: int | None = setting(
        128,
        "Hidden units of the perceptron that encodes a descriptor; null: a linear encoder.",
        at_least=1,
        at_most=65536,
    )
    prototypes: int | None = setting(
        2048,
        "Features of the demonstration in the score of similarity to it; null: no such score.",
        at_least=1,
        at_most=100_000,
    )
    cascade: int | None = setting(
        1024,
        "Instances of a frame that get messages once trained, those estimated to be best; null: all.",
        at_least=1,
    )
    read_out: str = setting(
        "product",
        "`product`: large only when both nodes matter; `perceptron`: the paper's.",
        choices=("product", "perceptron"),
    )
    precision: str = setting("float32", "Precision of the messages.", choices=("float32", "bfloat16"))
    memory_mb: int = setting(
        1024, "MiB that training keeps of a batch for the backward pass; beyond, states are recomputed.", at_least=1
    )


@final
@dataclass
class BilinearConfig(Config):
    """`model=bilinear`: a factorized score without message passing, for many features or little time."""

    name: str = setting("bilinear", "Network.")
    hidden_dim: int = setting(64, "Width of the encoders and of the inner product.", at_least=1, at_most=4096)


@final
@dataclass
class PrototypesConfig(Config):
    """`model=prototypes`: similarity to the demonstration alone, for many features or little time."""

    name: str = setting("prototypes", "Network.")
    prototypes: int = setting(
        2048, "Features of the demonstration that are kept per node type.", at_least=1, at_most=100_000
    )
    components: int = setting(16, "Kinds of association in the mixture.", at_least=1, at_most=1024)


MODELS: Mapping[str, type[Config]] = {
    "message_passing": MessagePassingConfig,
    "bilinear": BilinearConfig,
    "prototypes": PrototypesConfig,
}
"""The settings of the networks of this package, by name."""


@dataclass
class Learning(Config, ABC):
    """The settings of learning, which :class:`TrainConfig` and the command ``train.py`` share."""

    kernel: Any = setting("p2p", "Kernels of the ensemble; `auto`: those that the demonstration is about.")
    descriptor: Any = setting(lambda: ["sift", "lbd"], "Descriptors; a kernel takes those that fit its nodes.")
    model: Any = setting(MessagePassingConfig, "Network that scores the associations.")
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    demonstration: DemonstrationConfig = field(default_factory=DemonstrationConfig)
    objective: ObjectiveConfig = field(default_factory=ObjectiveConfig)
    optimizer: OptimizerConfig = field(default_factory=OptimizerConfig)
    trainer: TrainerConfig = field(default_factory=TrainerConfig)
    ema_decay: float | None = setting(
        0.99, "Decay per step of the moving average of the weights; null: the last weights.", at_least=0, below=1
    )
    early_stopping: EarlyStoppingConfig = field(default_factory=EarlyStoppingConfig)
    inference: InferenceConfig = field(default_factory=InferenceConfig)
    seed: int = setting(0, "Seed; a run is repeatable. In simulation it also draws the looks of things.", at_least=0)
    threads: int | None = setting(
        None, "Threads of PyTorch, and frames worked on at once; null: as many as PyTorch likes.", at_least=1
    )


@final
@dataclass
class TrainConfig(Learning):
    """What :func:`geoskill.learn` is told beside the demonstrations, with the defaults of ``train.py``.

    ``kernel`` and ``descriptor`` take a name, several names, or names with the arguments of their classes:
    ``descriptor={"sift": {"root": True}}``. ``model`` takes a name, or a mapping of ``name`` and arguments:
    ``model={"name": "bilinear", "hidden_dim": 8}``.
    """


@final
@dataclass
class ScenarioConfig(Config):
    """Conditions under which a simulated task is recorded (Fig. 8 of the paper)."""

    actor: str = setting("human", "Who does the task.", choices=("human", "robot"))
    confidence: float = setting(
        0.93,
        "Confidence of a human demonstrator; less means larger detours, hesitations and jitter.",
        above=0,
        at_most=1,
    )
    random_target: bool = setting(False, "Another table, and the target anywhere on it.")
    move_camera: bool = setting(False, "The camera turns about the scene and moves while it records.")
    occlusion: bool = setting(False, "Something passes before the target.")
    outside_fov: bool = setting(False, "The object leaves the picture and comes back.")
    illumination: bool = setting(False, "The room is dark, and a lamp is moved about in it.")
    severity: float = setting(1.0, "Strength of the difficulties; 0: none.", at_least=0, at_most=1.5)
