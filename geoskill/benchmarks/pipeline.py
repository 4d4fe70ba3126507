"""``python -m geoskill.benchmarks.pipeline``: frame rates of reading, extraction and selection."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import let_idle_threads_sleep, run_command
from geoskill.cli.settings import refusing
from geoskill.errors import InputError
from geoskill.io.frames import FrameSource

if TYPE_CHECKING:
    from geoskill.benchmarks.stages import Stages


def measure(cfg: DictConfig) -> None:
    """Measure, print the table, and write the report to ``hydra.run.dir``.

    Raises:
        InputError: when a value of the configuration or the video cannot be used.
    """
    let_idle_threads_sleep()  # has no effect once PyTorch is imported, as it is below
    stages, description = _prepare(cfg)
    _measure(stages, description, cfg.device, cfg.repeats, Path(HydraConfig.get().runtime.output_dir))


def _prepare(cfg: DictConfig) -> tuple["Stages", dict[str, Any]]:
    """Build the stages and the description of their skill; nothing below this reads the configuration."""
    from geoskill.benchmarks.machine import check_run
    from geoskill.benchmarks.stages import Stages
    from geoskill.cli.inputs import use_threads
    from geoskill.cli.progress import quiet_libraries
    from geoskill.skill.spec import build, describe

    check_run(cfg.repeats, cfg.device)
    if cfg.frames < 1:
        raise InputError(f"frames={cfg.frames}: expected at least 1")
    quiet_libraries()
    threads = use_threads(cfg.threads)
    plain: dict[str, Any] = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
    description = describe(
        plain["kernel"], plain["descriptor"], plain["model"], plain["features"], cfg.inference.alternatives
    )
    with refusing("model"):
        components = build(description)
    return Stages.of(_open_source(cfg), cfg.frames, components, cfg.device, threads), description


def _open_source(cfg: DictConfig) -> FrameSource:
    from geoskill.cli.footage import simulated_footage
    from geoskill.cli.inputs import array_store, open_recording

    if cfg.video is not None:
        return open_recording(cfg.video, None)
    choices = HydraConfig.get().runtime.choices
    if "scene" not in cfg.task:
        raise InputError(f"task={choices['task']} is no simulated task; expected one such as task=sorting, or video=…")
    return simulated_footage(cfg.task, cfg.scenario, cfg.seed, choices["scenario"], array_store(cfg)).source


def _measure(stages: "Stages", description: Mapping[str, Any], device: str, repeats: int, folder: Path) -> None:
    from geoskill.benchmarks.machine import describe_machine
    from geoskill.benchmarks.measurement import time_in_turns
    from geoskill.benchmarks.rates import rates_dict, rates_figure, rates_table
    from geoskill.benchmarks.stages import EXTRACT
    from geoskill.benchmarks.table import write_files

    timings = time_in_turns(stages.workloads(), repeats)
    count = len(stages.frames)
    table = rates_table(timings, count, EXTRACT)
    content = {
        "machine": describe_machine(device, stages.threads, repeats),
        "source": stages.source.name,
        "frames": count,
        "image_size": list(stages.frames[0].image.shape[1::-1]),
        "skill": description,
        "workloads": rates_dict(timings, count, EXTRACT),
    }
    write_files(content, table, rates_figure(timings, count), folder, "pipeline")
    print(table)
    print(folder)


if __name__ == "__main__":
    run_command("pipeline", measure)
