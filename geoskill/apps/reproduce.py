"""``python reproduce.py``: a table over several trainings, from one command."""

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from statistics import median
from typing import Any

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig, OmegaConf

from geoskill.apps.command import run_command
from geoskill.errors import InputError


def main() -> None:
    """Entry point of ``reproduce.py`` and ``geoskill-reproduce``."""
    run_command("reproduce", reproduce)


def reproduce(cfg: DictConfig) -> None:
    """Train and score every row over its seeds, then write the table.

    Raises:
        InputError: when the data are not given or not there.
        RuntimeError: when a training or a scoring fails; what has ended is kept.
    """
    from rich.progress import track

    artifact: dict[str, Any] = OmegaConf.to_container(cfg.artifact, resolve=True)  # type: ignore[assignment]
    if artifact["data"] is None:
        raise InputError("artifact.data is not set; expected the folder of the labelled sequences (artifact.data=DIR)")
    for sequence in (artifact["train_on"], *artifact["test_on"]):
        if not (Path(artifact["data"]) / sequence).is_dir():
            raise InputError(f"artifact.data={artifact['data']}: has no folder {sequence}; expected one with frames")
    if cfg.jobs < 1:
        raise InputError(f"jobs={cfg.jobs}: expected at least 1")
    folder = Path(HydraConfig.get().runtime.output_dir) / ("quick" if cfg.quick else "full")
    seeds = artifact["seeds"][:2] if cfg.quick else artifact["seeds"]
    runs = [
        (row, seed, folder / row.replace("=", "-") / str(seed), overrides)
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
    results: dict[str, list[dict[str, Any]]] = {}
    for row, _, run, _ in runs:
        results.setdefault(row, []).append(json.loads((run / "scores.json").read_text(encoding="utf-8")))
    table = make_table(results, artifact["test_on"])
    (folder / "table.md").write_text(table, encoding="utf-8")
    (folder / "table.json").write_text(json.dumps(results, indent=2), encoding="utf-8")
    print(table)
    print(folder)


def _train_and_score(artifact: Mapping[str, Any], seed: int, run: Path, overrides: Sequence[str], quick: bool) -> None:
    """One training and its scores, in processes of their own; nothing is done twice."""
    if (run / "scores.json").is_file():
        return
    data = Path(artifact["data"]).resolve()
    if not (run / "metrics.json").is_file():
        _python(
            "geoskill.apps.train",
            "task=video",
            f"task.path={data / artifact['train_on']}",
            f"seed={seed}",
            "threads=1",
            "logger=none",
            f"hydra.run.dir={run}",
            *(["trainer.max_epochs=2"] if quick else []),
            *overrides,
        )
    trained = json.loads((run / "metrics.json").read_text(encoding="utf-8"))
    scores: dict[str, Any] = {"seed": seed, "rsw": trained["rsw"], "steps": trained["steps"]}
    for sequence in artifact["test_on"]:
        _python(
            "geoskill.apps.evaluate",
            f"skill={run / 'skill.ckpt'}",
            f"video={data / sequence}",
            f"regions={data / sequence}.regions.json",
            f"every={artifact['every']}",
            f"hydra.run.dir={run / sequence}",
        )
        scores[sequence] = json.loads((run / sequence / "metrics.json").read_text(encoding="utf-8"))
    (run / "scores.json").write_text(json.dumps(scores, indent=2), encoding="utf-8")


def _python(module: str, *arguments: str) -> None:
    ended = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        last = (ended.stderr.strip().splitlines() or ["no message"])[-1]
        raise RuntimeError(f"{module} {' '.join(arguments)} ended with status {ended.returncode}: {last}")


def make_table(results: Mapping[str, Sequence[Mapping[str, Any]]], sequences: Sequence[str]) -> str:
    """A Markdown table: top-1 accuracy over the seeds, as median and worst, per row and sequence.

    >>> score = {"top1_accuracy": 0.95, "hand_rate": 0.0, "feasible_frames": 41, "frames": 41}
    >>> print(make_table({"default": [{"rsw": 0.002, "steps": 400, "human1": score}]}, ["human1"]))
    | | seeds | human1 median | worst | hand | feasible | RSW | steps |
    |---|---|---|---|---|---|---|---|
    | default | 1 | 0.950 | 0.950 | 0.000 | 41/41 | 0.20 % | 400 |
    <BLANKLINE>
    """
    head = ["", "seeds"]
    for sequence in sequences:
        head += [f"{sequence} median", "worst", "hand", "feasible"]
    head += ["RSW", "steps"]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, scores in results.items():
        cells = [name, str(len(scores))]
        for sequence in sequences:
            figures = [score[sequence] for score in scores]
            accuracies = [each["top1_accuracy"] for each in figures if each["top1_accuracy"] is not None]
            cells += [f"{median(accuracies):.3f}", f"{min(accuracies):.3f}"] if accuracies else ["none", "none"]
            cells += [
                f"{median(each['hand_rate'] for each in figures):.3f}",
                f"{figures[0]['feasible_frames']}/{figures[0]['frames']}",
            ]
        cells += [
            f"{100 * median(score['rsw'] for score in scores):.2f} %",
            f"{median(score['steps'] for score in scores):.0f}",
        ]
        lines.append(("| " + " | ".join(cells) + " |").replace("|  |", "| |", 1))
    return "\n".join(lines).replace("|  | seeds", "| | seeds") + "\n"
