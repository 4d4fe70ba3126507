"""What the files of a run's folder hold, as a page shows it; nothing where there is no such file."""

import base64
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import yaml

from geoskill.errors import InputError
from geoskill.io.marked_yaml import read_marked_yaml
from geoskill.skill.definition_edit import DEFINITION
from geoskill.viz.report.values import as_mapping

REPORT: Final = "report.html"
MAX_EMBEDDED_MB: Final = 16.0
"""Size of a video, or of a picture, up to which it is part of the page."""
PICTURE: Final = re.compile(r"definition/[a-z0-9_]+-[0-9]+-(?:moving|resting|node)[0-9]*\.png")
"""Of a task definition; anybody may have written other paths into it."""


def crop(folder: Path, node: Mapping[str, Any]) -> str | None:
    """Return the picture of a node of a task definition as a URL that holds it."""
    path = node.get("picture")
    return picture(folder / path) if isinstance(path, str) and PICTURE.fullmatch(path) else None


def video(path: Path, max_embedded_mb: float) -> dict[str, str] | None:
    """Return the video as base 64, or its name where it is too large; None where there is none."""
    if not path.is_file():
        return None
    if path.stat().st_size > 1e6 * max_embedded_mb:
        return {"name": path.name}
    return {"data": base64.b64encode(path.read_bytes()).decode("ascii")}


def picture(path: Path) -> str | None:
    """Return a picture as a URL that holds it; None where there is none."""
    if not path.is_file() or path.stat().st_size > 1e6 * MAX_EMBEDDED_MB:
        return None
    kind = "jpeg" if path.suffix == ".jpg" else "png"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode('ascii')}"


def tables(path: Path) -> list[list[list[str]]]:
    """Return the cells of the pipe tables of a Markdown file, without the lines below their headings."""
    tables: list[list[list[str]]] = []
    inside = False
    for line in text_in(path).splitlines():
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


def reports_in(folder: Path) -> list[str]:
    """Return the reports of a study's runs, relative to its folder."""
    return sorted(str(path.relative_to(folder)) for path in folder.glob(f"*/**/{REPORT}"))


def overrides(path: Path) -> list[str]:
    """Return what the command line set."""
    return [str(own) for own in yaml.safe_load(text_in(path)) or []]


def definition_in(folder: Path) -> Mapping[str, Any]:
    """Return a task definition; nothing where there is none that can be read, for a skill may be from anybody."""
    try:
        return as_mapping(read_marked_yaml(folder / DEFINITION).plain())
    except InputError:
        return {}


def json_in(path: Path) -> Mapping[str, Any]:
    """Return the values of a JSON file."""
    return as_mapping(json.loads(text_in(path) or "{}"))


def text_in(path: Path) -> str:
    """Return the text of a file."""
    return path.read_text(encoding="utf-8") if path.is_file() else ""
