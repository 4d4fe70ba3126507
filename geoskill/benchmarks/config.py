"""The configuration of the benchmarks."""

from dataclasses import dataclass, field
from typing import Any, final

from geoskill.cli.schemas import CacheConfig
from geoskill.config import Config, FeaturesConfig, ScenarioConfig
from geoskill.schema import setting


@final
@dataclass
class BenchmarkConfig(Config):
    """`geoskill.benchmarks.select_out` and `.training`: time and memory of a frame and of a training step."""

    features: list[int] = field(default_factory=lambda: [30, 60, 120, 250, 500, 1000, 2000])
    kernels: list[str] = field(default_factory=lambda: ["p2p", "l2l", "p2l"])
    models: list[str] = field(default_factory=lambda: ["default", "paper", "bilinear", "prototypes"])
    precisions: list[str] = field(default_factory=lambda: ["float32", "bfloat16"])
    repeats: int = setting(5, "Timed rounds, in which the variants take turns.", at_least=1)
    limit_s: float = setting(10.0, "Seconds from which on a variant is left out.", above=0)
    threads: int = setting(2, "Threads of PyTorch.", at_least=1)
    device: str = setting("cpu", "Device.", choices=("cpu", "cuda"))
    debug: bool = setting(False, "Show the traceback of an error.")


@final
@dataclass
class PipelineConfig(Config):
    """`geoskill.benchmarks.pipeline`: frame rates of reading, extraction and selection."""

    kernel: Any = setting("p2p", "Kernels of the ensemble.")
    descriptor: Any = setting(lambda: ["sift", "lbd"], "Descriptors; a kernel takes those that fit its nodes.")
    model: Any = setting("message_passing", "Network; it is not trained, which takes the same time.")
    features: FeaturesConfig = field(default_factory=FeaturesConfig)
    top_k: int = setting(10, "Associations listed per frame and member.", at_least=1)
    task: Any = setting(None, "Simulated task whose recording is used.")
    scenario: ScenarioConfig = field(default_factory=lambda: ScenarioConfig(actor="robot"))
    cache: CacheConfig = field(default_factory=CacheConfig)
    video: Any = setting(None, "A video file or a folder of images, in place of the recording.")
    seed: int = setting(0, "Seed of the recording.", at_least=0)
    frames: int = setting(60, "Frames, from the first on.", at_least=1)
    repeats: int = setting(5, "Timed rounds, in which the workloads take turns.", at_least=1)
    threads: int | None = setting(
        None, "Threads of PyTorch, and frames worked on at once; null: as many as PyTorch likes.", at_least=1
    )
    device: str = setting("cpu", "Device.", choices=("cpu", "cuda"))
    debug: bool = setting(False, "Show the traceback of an error.")


@final
@dataclass
class WaitingConfig(Config):
    """`geoskill.benchmarks.waiting`: what people wait for."""

    video: Any = setting(None, "The demonstration: a video file or a folder of images.")
    overrides: list[str] = field(default_factory=lambda: ["kernel=p2p"])
    frames: int = setting(60, "Live frames on which selection is timed.", at_least=1)
    repeats: int = setting(1, "Timed rounds.", at_least=1)
    threads: int = setting(2, "Threads of the training whose wall time is taken.", at_least=1)
    debug: bool = setting(False, "Show the traceback of an error.")
