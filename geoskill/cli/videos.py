"""Several videos: ``infer.py video=[a.mp4,b.mp4]`` is short for a sweep, a run for each, and ends with one table."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, final

import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.errors import HydraException
from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from geoskill.cli.command import FAILED_RUN
from geoskill.cli.paths import listed_paths
from geoskill.cli.study import read_metrics
from geoskill.cli.sweep import exit_on_failure, job_folders
from geoskill.io.atomic import write_text

VIDEO_SUFFIXES: Final = (".mp4", ".mov", ".avi", ".webm", ".mkv", ".m4v")
"""Of the files of a folder that is taken for one of videos; a single video may be called anything."""
DEFAULTS: Final = ("hydra/launcher=joblib", "threads=1")
"""What runs the videos: a process for each, as many at once as there are cores."""


def with_each_video(arguments: Sequence[str]) -> list[str]:
    """Return command-line arguments in which several videos are the values of a sweep.

    Several are a list, or a folder of videos without pictures. ``hydra.run.dir`` becomes the folder of the sweep.
    Without several, or where a sweep is asked for anyway, the arguments stay as they are.

    >>> with_each_video(["skill=RUN", "video=[a.mp4,b.mp4]", "threads=2"])
    ['-m', 'skill=RUN', 'video=a.mp4,b.mp4', 'threads=2', 'hydra/launcher=joblib']
    """
    given = next((own.removeprefix("video=") for own in arguments if own.startswith("video=")), None)
    if given is None:
        return list(arguments)
    videos = _videos_in(Path(given)) or listed_paths(given)
    if not videos or {"-m", "--multirun"} & set(arguments):
        return list(arguments)
    swept = [f"video={','.join(videos)}" if own.startswith("video=") else own for own in arguments]
    if len(videos) == 1:
        return swept
    swept = [own.replace("hydra.run.dir=", "hydra.sweep.dir=", 1) for own in swept]
    keys = [own.partition("=")[0] for own in swept]
    return ["-m", *swept, *(own for own in DEFAULTS if own.partition("=")[0] not in keys)]


def _videos_in(folder: Path) -> list[str]:
    """Return the videos of a folder that holds no pictures, in the order of their names; none of anything else."""
    try:
        files = sorted(path for path in folder.iterdir() if not path.name.startswith(".") and path.is_file())
    except (OSError, ValueError):  # no folder
        return []
    from geoskill.io.image_folder import IMAGE_SUFFIXES  # not before, for --help

    suffixes = {path.suffix.lower() for path in files}
    if suffixes & set(IMAGE_SUFFIXES):
        return []
    return [str(path) for path in files if path.suffix.lower() in VIDEO_SUFFIXES]


@final
class VideosSummary(Callback):
    """Callback that writes ``summary.md``, ``.csv`` and ``.json`` over the videos of a sweep: a row for each."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Summarize all videos, then exit with the status of the first one that failed, if any."""
        folder = Path(config.hydra.sweep.dir)
        runs = job_folders(folder)
        rows = [_row(run) for run in runs]
        if rows:
            write_rows(rows, folder)
            print((folder / "summary.md").read_text(encoding="utf-8"))
        print(folder.resolve(), flush=True)
        exit_on_failure([(str(row["video"]), run) for row, run in zip(rows, runs, strict=True)])


def write_rows(rows: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write a table of videos as Markdown, CSV and JSON.

    Args:
        rows: of the same columns; None where there is no value.
        folder: an existing one.
    """
    import pandas as pd

    table = pd.DataFrame(rows).convert_dtypes().astype(object)
    table = table.where(table.notna(), None)
    write_text(folder / "summary.md", table.to_markdown(index=False, floatfmt=".3f", missingval="") + "\n")
    write_text(folder / "summary.csv", table.to_csv(index=False))
    write_text(folder / "summary.json", json.dumps(list(rows), indent=2))


def _row(run: Path) -> dict[str, Any]:
    metrics: dict[str, Any] = {}
    failure = None
    try:
        overrides = yaml.safe_load((run / ".hydra" / "overrides.yaml").read_text(encoding="utf-8"))
        parsed = OverridesParser.create().parse_overrides(overrides)
        video = next(str(own.value()) for own in parsed if own.key_or_group == "video")
        if (run / FAILED_RUN).exists():
            failure = (run / FAILED_RUN).read_text(encoding="utf-8").strip().partition(" ")[2]
        if (run / "metrics.json").exists():
            metrics = read_metrics(run / "metrics.json")
    except (OSError, ValueError, TypeError, StopIteration, yaml.YAMLError, HydraException) as error:
        message = " ".join(str(error).split())
        print(f"warning: {run}: left out, its results cannot be read ({message})", file=sys.stderr)
        video, failure = run.name, message
    return {
        "video": video,
        "run": run.name,
        **{name: metrics.get(name) for name in ("frames", "frames_with_association", "mean_confidence")},
        "error": failure,
    }
