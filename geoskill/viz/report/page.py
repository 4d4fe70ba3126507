"""Writing of ``report.html``: what a run's folder holds, as one page that needs no network.

::

    skill.yaml, definition/   sentence, crops, phases
    associations.jsonl        curves over time, with a cursor that moves with the video
    overlay.mp4               in the page, or beside it where it is large
    metrics.json, .csv        metrics, reliability, curves of the training
    table.md, *.png           of a study
    .hydra/                   settings
"""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Final, final

import yaml

from geoskill.errors import InputError
from geoskill.io.atomic import atomic_open
from geoskill.io.marked_yaml import read_marked_yaml
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.definition_edit import DEFINITION
from geoskill.skill.member_status import State
from geoskill.viz.curves import read_training
from geoskill.viz.report.curves import MemberCurves, curves_of, read_top_lines

REPORT: Final = "report.html"
MAX_EMBEDDED_MB: Final = 16.0
"""Size of a video, or of a picture, up to which it is part of the page."""
PICTURE: Final = re.compile(r"definition/[a-z0-9_]+-[0-9]+-(?:moving|resting|node)[0-9]*\.png")
"""Of a task definition; anybody may have written other paths into it."""
MAX_SETTINGS: Final = 100_000
"""Characters of settings that are shown."""
CONTENT_SECURITY: Final = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval'; style-src 'unsafe-inline'; img-src data: blob:;"
    " media-src data: blob: 'self' file:; font-src data:"
)
"""What the page may load: nothing but itself, and the video beside it."""


@final
@dataclass(frozen=True)
class About:
    """What the files of a run do not say.

    Attributes:
        command: that wrote the run.
        next_commands: what can be done next, and the command for it.
        origin: where the skill comes from; None for a study.
        definition_folder: where the task definition is, if not in the run's folder.
        lines: of the members over time as in ``associations.jsonl``, if there is no such file.
    """

    command: str
    next_commands: Sequence[tuple[str, str]]
    origin: Provenance | None = None
    definition_folder: Path | None = None
    lines: Sequence[Mapping[str, Any]] = field(default_factory=tuple)


def write_report(folder: Path, about: About, max_embedded_mb: float = MAX_EMBEDDED_MB) -> Path:
    """Write ``report.html`` into the folder of a run whose other files are complete, and return its path.

    Args:
        folder: of the run.
        about: what its files do not say.
        max_embedded_mb: a larger video is not part of the page, which then refers to ``overlay.mp4`` beside it.
    """
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    template = environment.from_string(_part("page.html"))
    path = folder / REPORT
    with atomic_open(path) as file:
        file.write(template.render(_content(folder, about, max_embedded_mb)))
    return path


def _content(folder: Path, about: About, max_embedded_mb: float) -> dict[str, Any]:
    definition_folder = about.definition_folder or folder
    definition = _definition(definition_folder)
    metrics = _json(folder / "metrics.json")
    members = _mapping(definition.get("members"))
    lines = folder / "associations.jsonl"
    curves = curves_of(read_top_lines(lines) if lines.is_file() else about.lines, members)
    script, plots = _plots(folder, metrics, curves)
    return {
        "command": about.command,
        "task": definition.get("task") or _title(folder),
        "source": metrics.get("source") or metrics.get("video") or definition.get("source"),
        "found": metrics.get("found"),
        "constraints": [_constraint(definition_folder, name, _mapping(own)) for name, own in members.items()],
        # Frames of another video than the one of this run.
        "elsewhere": about.definition_folder is not None,
        "freedom": definition.get("degrees_of_freedom"),
        "phases": _phases(definition.get("phases")),
        "decidability": _pairs(definition.get("decidability") or metrics.get("decidability")),
        "ends": [(title, _picture(definition_folder / "definition" / name)) for title, name in ENDS],
        "video": _video(folder / "overlay.mp4", max_embedded_mb),
        "frames": _frames(curves),
        "states": [(str(state), _state_code(state)) for state in State],
        "metrics": _pairs({name: value for name, value in metrics.items() if not isinstance(value, dict | list)}),
        "members": {name: _pairs(_mapping(own)) for name, own in _mapping(metrics.get("members")).items()},
        "tables": _tables(folder / "table.md"),
        "pictures": [(name, _picture(folder / name)) for name in ("accuracy.png", "reliability.png", "training.png")]
        if (folder / "table.md").is_file()
        else [],
        "runs": _runs(folder),
        "origin": None if about.origin is None else _origin(about.origin),
        "overrides": _overrides(folder / ".hydra" / "overrides.yaml"),
        "settings": _text(folder / ".hydra" / "config.yaml")[:MAX_SETTINGS],
        "next_commands": about.next_commands,
        "files": sorted(
            own.name for own in folder.iterdir() if own.is_file() and own.suffix in SHOWN and own.name != REPORT
        ),
        "plots": plots,
        "plot_script": script,
        "bokeh": _bokeh() if script else "",
        "style": _part("page.css"),
        "script": _part("page.js"),
        "content_security": CONTENT_SECURITY,
    }


ENDS: Final = (("At the beginning", "first.jpg"), ("At the end", "last.jpg"))
SHOWN: Final = (".ckpt", ".jsonl", ".yaml", ".mp4", ".png", ".csv", ".json", ".md")


def _plots(
    folder: Path, metrics: Mapping[str, Any], curves: Sequence[MemberCurves]
) -> tuple[str, dict[str, list[str]]]:
    """Return the script of all plots, and their places in the page by section."""
    # It takes a second, and tests and programs that write no report do without.
    from bokeh.embed import components

    from geoskill.viz.report import plots

    figures: dict[str, list[Any]] = {"time": plots.time_figures(curves) if curves else []}
    table = folder / "metrics.csv"
    figures["training"] = plots.training_figures(read_training(table)) if table.is_file() else []
    own = {name: _mapping(member).get("reliability") for name, member in _mapping(metrics.get("members")).items()}
    bins = {name: rows for name, rows in own.items() if isinstance(rows, list) and any(row[0] for row in rows)}
    figures["reliability"] = [plots.reliability_figure(bins)] if bins else []
    everything = tuple(plot for section in figures.values() for plot in section)
    if not everything:
        return "", {name: [] for name in figures}
    script, places = components(everything)
    following = iter(places)
    return script, {name: [next(following) for _ in section] for name, section in figures.items()}


def _bokeh() -> str:
    from bokeh.resources import Resources

    return "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)


def _constraint(folder: Path, name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    associations = [_mapping(own) for own in entry.get("associations") or []]
    return {
        "name": name,
        "sentence": entry.get("sentence") or entry.get("meaning"),
        "kernel": entry.get("kernel"),
        "pin": entry.get("pin"),
        "facts": _pairs(
            {
                "kind": f"{entry.get('kernel')}: {entry.get('meaning')}",
                "features": entry.get("descriptor"),
                "done within": _with_unit(entry.get("goal_tolerance"), entry),
                "how sure, on average": _percent(entry.get("mean_confidence")),
                "error at the start": _with_unit(_mapping(entry.get("error_norm")).get("at_start"), entry),
                "error at the end": _with_unit(_mapping(entry.get("error_norm")).get("at_end"), entry),
                "rows of the error": ", ".join(map(str, entry.get("error_rows") or [])),
                "frames with it": f"{entry.get('frames_with_association')} of {entry.get('frames')}",
            }
        ),
        "associations": [
            {
                "number": own.get("number"),
                "share": _percent(own.get("share")),
                "confidence": _percent(own.get("mean_confidence")),
                "frame": own.get("seen_best_in_frame"),
                "nodes": [
                    (_mapping(node).get("role") or "node", _mapping(node).get("type"), _crop(folder, _mapping(node)))
                    for node in own.get("nodes") or []
                ],
            }
            for own in associations
        ],
    }


def _crop(folder: Path, node: Mapping[str, Any]) -> str | None:
    path = node.get("picture")
    return _picture(folder / path) if isinstance(path, str) and PICTURE.fullmatch(path) else None


def _phases(phases: Any) -> list[dict[str, Any]]:
    """Return the parts of the timeline, each from where the one before ends to where it has settled, in percent."""
    shown, start = [], 0.0
    for number, phase in enumerate(map(_mapping, phases or []), start=1):
        end = 100 * float(phase.get("settles_at", 1.0))
        until = ", ".join(f"{name} below {value:g}" for name, value in _mapping(phase.get("until")).items())
        members = ", ".join(map(str, phase.get("members") or []))
        shown.append({"number": number, "members": members, "left": start, "width": max(0.0, end - start), "end": end})
        shown[-1]["until"] = until
        start = end
    return shown


def _frames(curves: Sequence[MemberCurves]) -> dict[str, Any]:
    """Return what the page's script needs of each frame."""
    if not curves:
        return {"time_s": [], "frame": [], "members": []}
    first = curves[0]
    return {
        "time_s": first.time_s.tolist(),
        "frame": first.frame.tolist(),
        "members": [
            {
                "name": own.name,
                "unit": own.unit,
                "state": list(own.state),
                "norm": _rounded(own.norm.tolist()),
                "goal": _rounded(own.goal_norm.tolist()),
                "confidence": _rounded(own.confidence.tolist()),
                "certain": own.is_certain.tolist(),
                "switched": own.switched.tolist(),
            }
            for own in curves
        ],
    }


def _rounded(values: Sequence[float]) -> list[float | None]:
    return [None if value != value else round(value, 4) for value in values]


def _video(path: Path, max_embedded_mb: float) -> dict[str, str] | None:
    """Return the video as base 64, or its name where it is too large; None where there is none."""
    if not path.is_file():
        return None
    if path.stat().st_size > 1e6 * max_embedded_mb:
        return {"name": path.name}
    return {"data": base64.b64encode(path.read_bytes()).decode("ascii")}


def _picture(path: Path) -> str | None:
    """Return a picture as a URL that holds it; None where there is none."""
    if not path.is_file() or path.stat().st_size > 1e6 * MAX_EMBEDDED_MB:
        return None
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def _tables(path: Path) -> list[list[list[str]]]:
    """Return the cells of the pipe tables of a Markdown file, without the lines below their headings."""
    tables: list[list[list[str]]] = []
    inside = False
    for line in _text(path).splitlines():
        if not line.startswith("|"):
            inside = False
            continue
        if not inside:
            tables.append([])
            inside = True
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not all(re.fullmatch(":?-+:?", cell) for cell in cells):
            tables[-1].append(cells)
    return tables


def _runs(folder: Path) -> list[str]:
    """Return the reports of a study's runs, relative to its folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.glob(f"*/**/{REPORT}"))


def _origin(origin: Provenance) -> list[tuple[str, str]]:
    width, height = origin.image_size
    return _pairs(
        {
            "demonstrations": ", ".join(origin.sources),
            "picture": f"{width} x {height}",
            "begun": origin.date,
            "version": origin.version,
            "seed": origin.seed,
            "epochs": f"{origin.epochs[0]} of {origin.epochs[1]}",
            "finished": origin.finished,
            **{f"last {name}": value for name, value in origin.metrics.items()},
        }
    )


def _pairs(values: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return names and values as text; what is nested is named by dots, and empty values are left out."""
    if not isinstance(values, Mapping):
        return [] if values is None else [(prefix.rstrip("."), _shown(values))]
    return [pair for name, value in values.items() for pair in _named(f"{prefix}{name}", value)]


def _named(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        yield from _pairs(value, f"{name}.")
    elif value not in (None, "", []) and not (isinstance(value, list) and any(isinstance(own, list) for own in value)):
        yield name.replace("_", " "), _shown(value)


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return ", ".join(map(_shown, value)) if isinstance(value, list | tuple) else str(value)


def _with_unit(value: Any, entry: Mapping[str, Any]) -> str | None:
    return None if not isinstance(value, int | float) else f"{value:.3g} {entry.get('unit', '')}".rstrip()


def _percent(value: Any) -> str | None:
    return f"{100 * value:.0f} %" if isinstance(value, int | float) else None


def _state_code(state: State) -> str:
    from geoskill.viz.report.plots import state_code

    return state_code(state)


def _title(folder: Path) -> str:
    return f"Run {folder.name}"


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}


def _overrides(path: Path) -> list[str]:
    return [str(own) for own in yaml.safe_load(_text(path)) or []]


def _definition(folder: Path) -> Mapping[str, Any]:
    """Return a task definition; nothing where there is none that can be read, for a skill may be from anybody."""
    try:
        return _mapping(read_marked_yaml(folder / DEFINITION).plain())
    except InputError:
        return {}


def _json(path: Path) -> Mapping[str, Any]:
    return _mapping(json.loads(_text(path) or "{}"))


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.is_file() else ""


def _part(name: str) -> str:
    return resources.files("geoskill.viz.report").joinpath(name).read_text(encoding="utf-8")
