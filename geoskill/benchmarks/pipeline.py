"""``python -m geoskill.benchmarks.pipeline``: frame rates of reading, extraction and selection."""

from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import let_idle_threads_sleep, run_command
from geoskill.cli.settings import refusing
from geoskill.errors import InputError
from geoskill.io.frames import FrameSource


def measure(cfg: DictConfig) -> None:
    """Measure, print the table, and write it where ``hydra.run.dir`` says.

    Raises:
        InputError: for whatever the configuration or the video has wrong.
    """
    let_idle_threads_sleep()
    from geoskill.benchmarks.command import check_run, machine
    from geoskill.benchmarks.measurement import Figures, times_in_turn
    from geoskill.benchmarks.rates import plain_rates, rates_figure, rates_table
    from geoskill.benchmarks.stages import EXTRACT, Stages
    from geoskill.benchmarks.table import write_files
    from geoskill.cli.inputs import use_threads
    from geoskill.cli.progress import quiet_libraries
    from geoskill.skill.spec import build, describe

    check_run(cfg)
    if cfg.frames < 1:
        raise InputError(f"frames={cfg.frames}: expected at least 1")
    quiet_libraries()
    threads = use_threads(cfg.threads)
    plain: dict[str, Any] = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
    description = describe(
        plain["kernel"], plain["descriptor"], plain["model"], plain["features"], cfg.inference.alternatives
    )
    with refusing("model"):
        parts = build(description)
    stages = Stages.of(_source(cfg), cfg.frames, parts, cfg.device, threads)
    times = times_in_turn(stages.ways(), cfg.repeats)
    ways = {name: Figures(seconds) for name, seconds in times.items()}
    count = len(stages.frames)
    table = rates_table(ways, count, EXTRACT)
    content = {
        "machine": machine(cfg, threads),
        "source": stages.source.name,
        "frames": count,
        "image_size": list(stages.frames[0].image.shape[1::-1]),
        "skill": description,
        "ways": plain_rates(ways, count, EXTRACT),
    }
    folder = Path(HydraConfig.get().runtime.output_dir)
    write_files(content, table, rates_figure(ways, count), folder, "pipeline")
    print(table)
    print(folder)


def _source(cfg: DictConfig) -> FrameSource:
    from geoskill.cli.footage import simulated_footage
    from geoskill.cli.inputs import array_store, open_recording

    if cfg.video is not None:
        return open_recording(cfg.video, None)
    choices = HydraConfig.get().runtime.choices
    if "scene" not in cfg.task:
        raise InputError(f"task={choices['task']} is no simulated task; expected one such as task=sorting, or video=…")
    return simulated_footage(cfg.task, cfg.scenario, cfg.seed, choices["scenario"], array_store(cfg)).source


if __name__ == "__main__":
    run_command("pipeline", measure)
