"""``python reproduce.py``: a table of the paper, or one beside it, from one command."""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import run_command
from geoskill.errors import InputError
from geoskill.evaluation.tables import accuracies, as_csv, details, overview, reliability_of

QUICK_TRAINING = ("trainer.max_epochs=2",)
QUICK_EVERY = 10
BASELINE = "hand-picked trackers"


def main() -> None:
    """Entry point of ``reproduce.py`` and ``geoskill-reproduce``."""
    run_command("reproduce", reproduce)


def reproduce(cfg: DictConfig) -> None:
    """Train and score every row over its seeds, then write the table and the picture.

    Raises:
        InputError: when the data are not given or not there.
        RuntimeError: when a training or a scoring fails; what has ended is kept.
    """
    from rich.progress import track

    if "data" in cfg.artifact and cfg.artifact.data is None:
        raise InputError("artifact.data is not set; expected the folder of the labeled sequences (artifact.data=DIR)")
    artifact: dict[str, Any] = OmegaConf.to_container(cfg.artifact, resolve=True)  # type: ignore[assignment]
    for override in (*artifact["train"], *(value for test in artifact["tests"].values() for value in test)):
        key, _, path = override.partition("=")
        if key in ("task.path", "video") and not Path(path).is_dir():
            raise InputError(
                f"artifact.data={artifact['data']}: has no folder {Path(path).name}; expected one with frames"
            )
    if cfg.jobs < 1:
        raise InputError(f"jobs={cfg.jobs}: expected at least 1")
    folder = Path(HydraConfig.get().runtime.output_dir) / ("quick" if cfg.quick else "full")
    seeds = artifact["seeds"][:1] if cfg.quick else artifact["seeds"]
    runs = [
        (row, seed, folder / row.replace("=", "-").replace(" ", "_") / str(seed), overrides)
        for row, overrides in artifact["rows"].items()
        for seed in seeds
    ]
    with ThreadPoolExecutor(cfg.jobs) as pool:
        jobs = [pool.submit(_train_and_score, artifact, seed, run, over, cfg.quick) for _, seed, run, over in runs]
        try:
            for job in track(jobs, description="training and scoring"):
                job.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    scores: dict[str, list[dict[str, Any]]] = {}
    curves: dict[str, list[Path]] = {}
    for row, _, run, _ in runs:
        scores.setdefault(row, []).append(json.loads((run / "scores.json").read_text(encoding="utf-8")))
        curves.setdefault(row, []).append(run / "metrics.csv")
    _write(folder, artifact, scores, curves)
    print((folder / "table.md").read_text(encoding="utf-8"))
    print(folder)


def _write(
    folder: Path,
    artifact: Mapping[str, Any],
    scores: Mapping[str, Sequence[Mapping[str, Any]]],
    curves: Mapping[str, Sequence[Path]],
) -> None:
    from geoskill.viz.bars import plot_bars, plot_reliability, plot_trainings

    tests = list(artifact["tests"])
    published = dict(artifact["published"])
    if artifact["baseline"]:
        published = {BASELINE: _baseline(scores, tests), **published}
    table = overview(scores, tests, published) + "\n" + details(scores, tests)
    (folder / "table.md").write_text(table, encoding="utf-8")
    (folder / "table.csv").write_text(as_csv(scores, tests), encoding="utf-8")
    (folder / "table.json").write_text(json.dumps({"scores": scores, "published": published}, indent=2), "utf-8")
    rows = {row: [accuracies(seeds, test) for test in tests] for row, seeds in scores.items()}
    plot_bars(tests, rows, published, folder / "accuracy.png")
    plot_reliability({row: reliability_of(seeds, tests) for row, seeds in scores.items()}, folder / "reliability.png")
    plot_trainings(curves, folder / "training.png")


def _baseline(scores: Mapping[str, Sequence[Mapping[str, Any]]], tests: Sequence[str]) -> dict[str, float]:
    """The percentage of recordings on which the trackers succeed; the recordings are those of every row."""
    seeds = next(iter(scores.values()))
    return {test: 100 * sum(seed[test]["baseline_success"] for seed in seeds) / len(seeds) for test in tests}


def _train_and_score(artifact: Mapping[str, Any], seed: int, run: Path, overrides: Sequence[str], quick: bool) -> None:
    """One training and its scores, in processes of their own; nothing is done twice."""
    from geoskill.io.atomic import atomic_open

    if (run / "scores.json").is_file():
        return
    training = [*artifact["train"], *overrides]
    if not (run / "metrics.json").is_file():
        _python(
            "geoskill.cli.train",
            *training,
            *(QUICK_TRAINING if quick else ()),
            f"seed={seed}",
            "threads=1",
            "logger=none",
            f"hydra.run.dir={run}",
        )
    trained = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    scores: dict[str, Any] = {"seed": seed, "rsw": trained["rsw"], "steps": trained["steps"]}
    simulated = [override for override in training if override.startswith("task=") and override != "task=video"]
    for test, settings in artifact["tests"].items():
        # In simulation the test is of the task that was learned, the last one named.
        _python(
            "geoskill.cli.evaluate",
            f"skill={run / 'skill.ckpt'}",
            *simulated[-1:],
            *settings,
            f"every={QUICK_EVERY if quick else artifact['every']}",
            f"hydra.run.dir={run / test}",
        )
        scores[test] = json.loads((run / test / "metrics.json").read_text(encoding="utf-8"))
    with atomic_open(run / "scores.json") as file:  # a whole one says that all of this is done
        json.dump(scores, file, indent=2)


def _python(module: str, *arguments: str) -> None:
    ended = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        last = (ended.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"{module} {' '.join(arguments)} ended with status {ended.returncode}: {last}")


if __name__ == "__main__":
    main()
