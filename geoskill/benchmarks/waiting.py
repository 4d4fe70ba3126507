"""``python -m geoskill.benchmarks.waiting``: what people wait for: a skill, the start of a program, a live frame.

Processor time (user and system) counts what a program works, whatever else runs on the machine; wall time needs an idle
one. Every program is a process of its own.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from statistics import median
from typing import final

from geoskill.benchmarks.config import WaitingConfig
from geoskill.cli.command import Run, run_command
from geoskill.errors import InputError
from geoskill.io.frames import FrameSource

# The first frames have no past, which makes selection cheaper.
WARM_UP_FRAMES = 12


@final
@dataclass(frozen=True)
class Waited:
    """How long something took.

    Attributes:
        what: in words.
        seconds: of every round.
        clock: ``processor`` or ``wall``.
    """

    what: str
    seconds: Sequence[float]
    clock: str


def measure(config: WaitingConfig, run: Run) -> None:
    """Measure, print the table, and write it with ``waiting.json`` to ``hydra.run.dir``.

    Raises:
        InputError: when there is no video, it cannot be read, or a program fails.
    """
    from geoskill.benchmarks.machine import describe_machine
    from geoskill.benchmarks.table import write_files
    from geoskill.cli.inputs import open_recording, required

    # Whatever is wrong with it is told before anything is timed.
    source = open_recording(required("video", config.video, "a demonstration"), None)
    with tempfile.TemporaryDirectory() as folder:
        rows = list(_measure(config, source, Path(folder)))
    table = markdown(rows)
    content = {
        "machine": describe_machine("cpu", config.threads, config.repeats),
        "source": source.name,
        "rows": [asdict(row) for row in rows],
    }
    write_files(content, table, None, run.folder, "waiting")
    print(table)
    print(run.folder)


def _measure(config: WaitingConfig, source: FrameSource, folder: Path) -> Iterator[Waited]:
    training = ["-m", "geoskill.cli.train"]
    for threads, clock in ((1, "processor"), (config.threads, "wall")):
        seconds = []
        for number in range(config.repeats):
            settings = ["task=video", f"task.path='{config.video}'", "logger=none", f"threads={threads}"]
            cold = f"cache.folder='{folder}/cache {clock} {number}'"
            ended = timed([*training, *settings, cold, f"hydra.run.dir='{folder}/{clock}'", *config.overrides])
            seconds.append(ended[clock == "wall"])
        yield Waited(f"the whole command, {threads} thread{'s'[: threads > 1]}", seconds, clock)
    learned = folder / "processor"
    starts = {
        "train --help": [*training, "--help"],
        "import geoskill": ["-c", "import geoskill"],
        "Skill.load": ["-c", f"import geoskill; geoskill.Skill.load({str(learned)!r})"],
    }
    for what, program in starts.items():
        yield Waited(what, [timed(program)[0] for _ in range(config.repeats)], "processor")
    yield Waited("selection of a live frame, 1 thread", _selections(config, source, learned), "processor")


def timed(program: Sequence[str]) -> tuple[float, float]:
    """Run Python with these arguments and return its processor and wall time in seconds.

    Raises:
        InputError: when it fails, with the last line that it printed.
    """
    before = time.perf_counter()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen([sys.executable, *program], stdout=output, stderr=output)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.perf_counter() - before
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != 0:
            output.seek(0)
            lines = output.read().decode(errors="replace").strip().splitlines()
            raise InputError(f"{' '.join(program)}: {lines[-1] if lines else f'status {process.returncode}'}")
    return usage.ru_utime + usage.ru_stime, wall


def _selections(config: WaitingConfig, source: FrameSource, skill_folder: Path) -> list[float]:
    """Return processor time per frame, one value for each round."""
    from geoskill.skill.skill import Skill
    from geoskill.skill.temporal_filter import TemporalFilter
    from geoskill.training.trainer import use_threads

    skill = Skill.load(skill_folder)
    images = [frame.image for frame in islice(source, WARM_UP_FRAMES + config.frames)]
    features = [skill.extract(image) for image in images]
    warm_up = min(WARM_UP_FRAMES, len(images) - 1)
    rounds = []
    with use_threads(1):
        for _ in range(config.repeats):
            temporal = TemporalFilter(skill)
            for number, (image, own) in enumerate(zip(images, features, strict=True)):
                if number == warm_up:
                    before = time.process_time()
                temporal.infer(image, own)
            rounds.append((time.process_time() - before) / (len(images) - warm_up))
    return rounds


def markdown(rows: Sequence[Waited]) -> str:
    """Return the table: medians, and the range of the rounds.

    >>> print(markdown([Waited("Skill.load", [3.0, 1.0, 2.5], "processor")]))
    | | clock | s | range |
    |---|---|---|---|
    | Skill.load | processor | 2.50 | 1.00-3.00 |
    <BLANKLINE>
    """
    lines = ["| | clock | s | range |", "|---|---|---|---|"]
    for row in rows:
        digits = 2 if median(row.seconds) >= 0.1 else 4
        low, middle, high = (f"{pick(row.seconds):.{digits}f}" for pick in (min, median, max))
        lines.append(f"| {row.what} | {row.clock} | {middle} | {low}-{high} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    run_command("waiting", WaitingConfig, measure)
