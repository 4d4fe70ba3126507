"""Writing of ``report.html``: what a run's folder holds, as one page that needs no network.

::

    skill.yaml, definition/   sentence, crops, phases
    associations.jsonl        curves over time, with a cursor that moves with the video
    overlay.mp4               in the page, or beside it where it is large
    metrics.json, .csv        metrics, reliability, curves of the training
    table.md, *.png           of a study
    .hydra/                   settings
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any, Final, final

from geoskill.io.atomic import atomic_open
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.member_status import State
from geoskill.viz.curves import read_training
from geoskill.viz.report.curves import MemberCurves, curves_of, read_top_lines
from geoskill.viz.report.files import (
    MAX_EMBEDDED_MB,
    REPORT,
    crop,
    definition_in,
    json_in,
    overrides,
    picture,
    reports_in,
    tables,
    text_in,
    video,
)
from geoskill.viz.report.values import as_mapping, pairs, percent, rounded, with_unit

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
    definition = definition_in(definition_folder)
    metrics = json_in(folder / "metrics.json")
    members = as_mapping(definition.get("members"))
    lines = folder / "associations.jsonl"
    curves = curves_of(read_top_lines(lines) if lines.is_file() else about.lines, members)
    script, plots = _plots(folder, metrics, curves)
    return {
        "command": about.command,
        "task": definition.get("task") or _title(folder),
        "source": metrics.get("source") or metrics.get("video") or definition.get("source"),
        "found": metrics.get("found"),
        "constraints": [_constraint(definition_folder, name, as_mapping(own)) for name, own in members.items()],
        # Frames of another video than the one of this run.
        "elsewhere": about.definition_folder is not None,
        "freedom": definition.get("degrees_of_freedom"),
        "phases": _phases(definition.get("phases")),
        "decidability": _decidability(as_mapping(definition.get("decidability") or metrics.get("decidability"))),
        "ends": [(title, picture(definition_folder / "definition" / name)) for title, name in ENDS],
        "video": video(folder / "overlay.mp4", max_embedded_mb),
        "frames": _frames(curves),
        "states": [(str(state), _state_code(state)) for state in State],
        "metrics": pairs({name: value for name, value in metrics.items() if not isinstance(value, dict | list)}),
        "members": {name: pairs(as_mapping(own)) for name, own in as_mapping(metrics.get("members")).items()},
        "tables": tables(folder / "table.md"),
        "pictures": [(name, picture(folder / name)) for name in ("accuracy.png", "reliability.png", "training.png")]
        if (folder / "table.md").is_file()
        else [],
        "runs": reports_in(folder),
        "origin": None if about.origin is None else _origin(about.origin),
        "overrides": overrides(folder / ".hydra" / "overrides.yaml"),
        "settings": text_in(folder / ".hydra" / "config.yaml")[:MAX_SETTINGS],
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
    own = {name: as_mapping(member).get("reliability") for name, member in as_mapping(metrics.get("members")).items()}
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
    associations = [as_mapping(own) for own in entry.get("associations") or []]
    return {
        "name": name,
        "sentence": entry.get("sentence") or entry.get("meaning"),
        "kernel": entry.get("kernel"),
        "pin": entry.get("pin"),
        "facts": pairs(
            {
                "kind": f"{entry.get('kernel')}: {entry.get('meaning')}",
                "features": entry.get("descriptor"),
                "done when what is left to the goal is within": with_unit(entry.get("goal_tolerance"), entry),
                "how sure of what it has learned, on average": percent(entry.get("mean_confidence")),
                "distance at the start": with_unit(as_mapping(entry.get("error_norm")).get("at_start"), entry),
                "distance at the end, which the goal takes into account": with_unit(
                    as_mapping(entry.get("error_norm")).get("at_end"), entry
                ),
                "rows of the error": ", ".join(map(str, entry.get("error_rows") or [])),
                "frames with it": f"{entry.get('frames_with_association')} of {entry.get('frames')}",
            }
        ),
        "associations": [
            {
                "number": own.get("number"),
                "share": percent(own.get("share")),
                "confidence": percent(own.get("mean_confidence")),
                "frame": own.get("seen_best_in_frame"),
                "nodes": [
                    (
                        as_mapping(node).get("role") or "node",
                        as_mapping(node).get("type"),
                        crop(folder, as_mapping(node)),
                    )
                    for node in own.get("nodes") or []
                ],
            }
            for own in associations
        ],
    }


def _decidability(found: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what each view determines as the rows of a table, and whether the pictures decide the task."""
    if not found:
        return None
    rows = []
    for view in ("one_camera", "two_cameras", "depth"):
        own = as_mapping(found.get(view))
        if own:
            weak = [
                f"{motion.get('motion')} (to {motion.get('mm')} mm, {motion.get('deg')}°)"
                for motion in map(as_mapping, own.get("weak") or [])
            ]
            free, badly = (", ".join(map(str, names)) or "nothing" for names in (own.get("free") or [], weak))
            rows.append((view.replace("_", " "), f"{own.get('determined')} of {own.get('of')}", free, badly))
    return {"rows": rows, "decidable": found.get("decidable")}


def _phases(phases: Any) -> list[dict[str, Any]]:
    """Return the parts of the timeline, each from where the one before ends to where it has settled, in percent."""
    shown, start = [], 0.0
    for number, phase in enumerate(map(as_mapping, phases or []), start=1):
        end = 100 * float(phase.get("settles_at", 1.0))
        until = ", ".join(f"{name} below {value:g}" for name, value in as_mapping(phase.get("until")).items())
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
                "norm": rounded(own.norm.tolist()),
                "goal": rounded(own.goal_norm.tolist()),
                "confidence": rounded(own.confidence.tolist()),
                "certain": own.is_certain.tolist(),
                "switched": own.switched.tolist(),
            }
            for own in curves
        ],
    }


def _origin(origin: Provenance) -> list[tuple[str, str]]:
    width, height = origin.image_size
    return pairs(
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


def _state_code(state: State) -> str:
    from geoskill.viz.report.plots import state_code

    return state_code(state)


def _title(folder: Path) -> str:
    return f"Run {folder.name}"


def _part(name: str) -> str:
    return resources.files("geoskill.viz.report").joinpath(name).read_text(encoding="utf-8")
