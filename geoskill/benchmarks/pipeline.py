"""``python -m geoskill.benchmarks.pipeline``: frame rates of reading, extraction and selection."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geoskill.benchmarks.config import PipelineConfig
from geoskill.cli.command import Run, run_command
from geoskill.cli.schemas import SimulatedTaskConfig
from geoskill.errors import InputError
from geoskill.io.frames import FrameSource

if TYPE_CHECKING:
    from geoskill.benchmarks.stages import Stages


def measure(config: PipelineConfig, run: Run) -> None:
    """Measure, print the table, and write the report to ``hydra.run.dir``.

    Raises:
        InputError: when a value of the configuration or the video cannot be used.
    """
    from geoskill.benchmarks.machine import check_run
    from geoskill.benchmarks.stages import Stages
    from geoskill.cli.inputs import use_threads
    from geoskill.skill.plan import plan_skill
    from geoskill.training.quiet import quiet_libraries

    check_run(config.repeats, config.device)
    with quiet_libraries():
        threads = use_threads(config.threads)
        spec = plan_skill(config.kernel, config.descriptor, config.model, config.features, config.top_k)
        stages = Stages.of(_open_source(config, run), config.frames, spec, config.device, threads)
        _measure(stages, spec.as_plain(), config.device, config.repeats, run.folder)


def _open_source(config: PipelineConfig, run: Run) -> FrameSource:
    from geoskill.cli.inputs import open_disk_cache, open_recording
    from geoskill.cli.sequences import labeled_recording
    from geoskill.skill.checkpoint import SimulatedScene

    if config.video is not None:
        return open_recording(config.video, None)
    if not isinstance(config.task, SimulatedTaskConfig):
        name = run.choices["task"]
        raise InputError(f"task={name} is no simulated task; expected one such as task=sorting, or video=…")
    scene = SimulatedScene(config.task.name, config.seed, config.scenario)
    store = open_disk_cache(config.cache)
    return labeled_recording(scene, run.choices["scenario"], store, config.task.depth).source


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
    run_command("pipeline", PipelineConfig, measure)
