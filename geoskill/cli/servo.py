"""``python servo.py``: close the loop in simulation, trial by trial."""

import csv
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from geoskill.cli.command import Run, run_command
from geoskill.cli.schemas import ServoCommandConfig, SimulatedTaskConfig
from geoskill.errors import InputError
from geoskill.schema import as_plain

if TYPE_CHECKING:
    from geoskill.control.plant import Placement, Plant
    from geoskill.control.sequence import Phase
    from geoskill.control.state import Record, Setup
    from geoskill.control.trial import TrialResult

SETTINGS: Final = "settings.json"
TRIALS: Final = "trials.csv"
FRAMES: Final = "frames.csv"
# What another attempt at the same benchmark may change.
FREE: Final = ("trials", "debug", "cache", "skill", "device")


def main() -> None:
    """Run ``servo.py`` or ``geoskill-servo``."""
    run_command("servo", ServoCommandConfig, servo)


def servo(config: ServoCommandConfig, run: Run) -> None:
    """Write ``trials.csv``, ``frames.csv``, ``servo.jsonl``, ``metrics.json``, ``servo.png``; trials there are kept.

    Raises:
        InputError: for settings that do not go together, or a folder that was begun with others.
    """
    from geoskill.cli.servo_log import ServoLog
    from geoskill.cli.summary import print_summary, script
    from geoskill.control.trial import run_trial
    from geoskill.evaluation.servo import SUCCESS_DEG, SUCCESS_MM, summarize_trials
    from geoskill.exports.record import step_record
    from geoskill.io.atomic import atomic_open
    from geoskill.viz.servo import plot_trials

    _check(config)
    _claim(config, run.folder)
    results, curves = _read(run.folder)
    log = ServoLog(run.folder, len(results))
    with _plants(config, run) as (plant_of, phases):
        setup = _setup(config, phases)
        for trial in range(len(results), config.trials):
            rows: list[dict[str, Any]] = []
            steps: list[dict[str, Any]] = []

            def watch(
                record: "Record",
                placement: "Placement",
                rows: list[dict[str, Any]] = rows,
                steps: list[dict[str, Any]] = steps,
            ) -> None:
                steps.append(step_record(record, setup.space, config.servo.rate_hz))
                rms = float("nan") if record.rms is None else record.rms
                rows.append({"rms_px": rms, "mm": placement.mm, "deg": placement.deg})

            with plant_of(trial) as plant:
                explores = config.controller.name in ("field", "broyden")
                results.append(run_trial(setup, plant, explores=explores, watch=watch))
            log.add(trial, steps)
            curves[trial] = {key: [row[key] for row in rows] for key in rows[0]}
            _write(run.folder, results, curves)
            last = results[-1]
            print(f"trial {trial}: {last.ended} {last.reason}".rstrip() + f", {last.mm:.2f} mm, {last.deg:.2f}°")
    metrics = summarize_trials(results)
    with atomic_open(run.folder / "metrics.json") as file:
        json.dump({**_described(config), **metrics}, file, indent=2)
    plot_trials(curves, run.folder / "servo.png", {"mm": SUCCESS_MM, "deg": SUCCESS_DEG})
    low, high = metrics["success_interval"]
    line = (
        f"{metrics['trials']} trials: success {metrics['success_rate']:.3f} ({low:.3f} to {high:.3f}), median"
        f" {metrics['median_mm']:.2f} mm, {metrics['median_deg']:.2f}°, {metrics['median_steps']:.0f} frames"
    )
    more = script("servo", *run.overrides, f"trials={2 * config.trials}", f"hydra.run.dir={run.folder}")
    print_summary([line], run.folder, [f"{more}   # more trials, those that are there kept"])


def _check(config: ServoCommandConfig) -> None:
    """Refuse settings that do not go together."""
    if config.plant.name == "points":
        for key in ("skill", "definition"):
            if getattr(config, key) is not None:
                raise InputError(f"{key}={getattr(config, key)}: plant=points has no pictures; expected plant=scene")
        return
    if config.faults != "none":
        raise InputError(f"faults={config.faults}: only plant=points has faults; expected faults=none, or a scenario=…")
    if not isinstance(config.task, SimulatedTaskConfig):
        raise InputError("task is no simulated task; expected one such as task=insertion")
    if config.select in ("skill", "top") and config.controller.name != "truth" and config.skill is None:
        raise InputError("skill is not set; expected the skill.ckpt of a training run, or select=truth (skill=…)")


def _setup(config: ServoCommandConfig, phases: "tuple[Phase, ...]") -> "Setup":
    from geoskill.control.action import action_space
    from geoskill.control.state import Setup, limits_of

    return Setup(
        action_space(config.dof, limits_of(config.servo)),
        config.servo,
        ((640, 480),) * config.cameras,
        guarded=config.dof == "descent",
        uses_slots=config.controller.name == "broyden",
        phases=phases,
    )


@contextmanager
def _plants(config: ServoCommandConfig, run: Run) -> Iterator[Any]:
    """Give the function that opens the plant of a trial, and the phases of the task."""
    if config.plant.name == "points":
        yield lambda trial: _points(config, trial), ()
        return
    from geoskill.cli.simulated_plant import SimulatedPlants

    plants = SimulatedPlants(config, run)
    yield plants.trial, plants.phases


@contextmanager
def _points(config: ServoCommandConfig, trial: int) -> Iterator["Plant"]:
    import numpy as np

    from geoskill.control.action import action_space
    from geoskill.control.points_plant import FAULTS, PointsPlant, points_cameras
    from geoskill.control.state import limits_of
    from geoskill.plugins import KERNELS

    kernels = [KERNELS.build(name, {})() for name in ["p2p"] * config.plant.pairs + ["l2l"] * config.plant.lines]
    knowledge = {"calibrated": "camera", "truth": "truth"}.get(config.controller.name, "none")
    yield PointsPlant(
        np.random.default_rng([config.seed, trial]),
        action_space(config.dof, limits_of(config.servo)),
        points_cameras(config.cameras),
        kernels,
        FAULTS[config.faults],
        has_support=config.dof == "descent",
        knowledge=knowledge,
    )


def _described(config: ServoCommandConfig) -> dict[str, Any]:
    """Return what the metrics are of."""
    task = config.task.name if isinstance(config.task, SimulatedTaskConfig) else None
    return {
        "plant": config.plant.name,
        "controller": config.controller.name,
        "task": task if config.plant.name == "scene" else None,
        "skill": config.skill,
        "phases": config.phases if config.plant.name == "scene" else None,
        "select": config.select if config.plant.name == "scene" else None,
        "faults": config.faults,
        "dof": config.dof,
        "cameras": config.cameras,
        "seed": config.seed,
    }


def _claim(config: ServoCommandConfig, folder: Path) -> None:
    """Note the settings in the folder, or check that they are those that it was begun with."""
    from geoskill.io.atomic import atomic_open

    plain = {key: value for key, value in as_plain(config).items() if key not in FREE}
    path = folder / SETTINGS
    if path.is_file():
        try:
            begun = json.loads(path.read_text(encoding="utf-8"))
        except ValueError as error:
            raise InputError(f"{path}: is damaged ({error}); expected another hydra.run.dir") from error
        for key, value in plain.items():
            if begun.get(key) != value:
                raise InputError(
                    f"{folder}: was begun with {key}={begun.get(key)}; expected {key}={value}, or another hydra.run.dir"
                )
        return
    with atomic_open(path) as file:
        json.dump(plain, file, indent=2)


def _write(folder: Path, results: "list[TrialResult]", curves: dict[int, dict[str, list[float]]]) -> None:
    from geoskill.io.atomic import atomic_open

    with atomic_open(folder / FRAMES) as file:
        table = csv.writer(file)
        table.writerow(["trial", "frame", "rms_px", "mm", "deg"])
        for trial, own in curves.items():
            for frame, values in enumerate(zip(own["rms_px"], own["mm"], own["deg"], strict=True)):
                table.writerow([trial, frame, *(f"{value:.4g}" for value in values)])
    # Last, since it says how many trials are complete.
    with atomic_open(folder / TRIALS) as file:
        writer = csv.DictWriter(file, ["trial", *results[0].as_row()])
        writer.writeheader()
        writer.writerows({"trial": trial, **own.as_row()} for trial, own in enumerate(results))


def _read(folder: Path) -> "tuple[list[TrialResult], dict[int, dict[str, list[float]]]]":
    """Return the trials that an earlier attempt completed.

    Raises:
        InputError: when they cannot be read.
    """
    from geoskill.control.trial import TrialResult

    results: list[TrialResult] = []
    curves: dict[int, dict[str, list[float]]] = {}
    if not (folder / TRIALS).is_file():
        return results, curves
    kinds = {own.name: str(own.type) for own in fields(TrialResult)}

    def parsed(key: str, text: str) -> Any:
        if kinds[key] in ("str", "<class 'str'>"):
            return text
        return None if text == "" else int(text) if "int" in kinds[key] else float(text)

    try:
        with (folder / TRIALS).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                row.pop("trial")
                results.append(TrialResult(**{key: parsed(key, text) for key, text in row.items()}))
        with (folder / FRAMES).open(encoding="utf-8", newline="") as file:
            for row in csv.DictReader(file):
                own = curves.setdefault(int(row["trial"]), {"rms_px": [], "mm": [], "deg": []})
                for key, values in own.items():
                    values.append(float(row[key]))
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise InputError(f"{folder / TRIALS}: cannot be read ({error}); expected another hydra.run.dir") from error
    return results, {trial: own for trial, own in curves.items() if trial < len(results)}


if __name__ == "__main__":
    main()
