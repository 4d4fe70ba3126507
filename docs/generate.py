"""Pages that are made from the package: the configuration reference and one API page per room.

Runs by itself (``python docs/generate.py``) and at the beginning of every build; writes into ``docs/_generated``.
"""

import contextlib
import importlib
import shutil
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
GENERATED = DOCS / "_generated"

# Rooms in the order of their floors, with what their pages are called. A room that does not exist is left out.
ROOMS = {
    "geometry": "geometry: points, lines, cameras",
    "kernels": "kernels: skill kernels",
    "objective": "objective: rewards and likelihoods",
    "io": "io: frames, video, files, cache",
    "features": "features: detectors and descriptors",
    "simulation": "simulation: rendered tasks",
    "tracking": "tracking: flow, trajectories, co-motion",
    "graphs": "graphs: frames as graphs",
    "model": "model: networks that score instances",
    "skill": "skill: learned skills",
    "data": "data: demonstrations as transitions",
    "training": "training: learning a skill",
    "evaluation": "evaluation: labels and metrics",
    "viz": "viz: pictures and video",
    "control": "control: visual servoing",
    "exports": "exports: ROS 2, ViSP, Machine Vision Toolbox",
}
TOP_LEVEL = ("config", "tuning", "plugins", "testing", "schema", "errors")


def configuration() -> str:
    """Return the reference of all configuration keys, from ``markdown_reference()`` where the package has it."""
    for name in ("geoskill.config", "geoskill.cli.schemas"):
        with contextlib.suppress(ImportError):
            module = importlib.import_module(name)
            if hasattr(module, "markdown_reference"):
                return str(module.markdown_reference())
    shown = subprocess.run(
        [sys.executable, str(ROOT / "train.py"), "--cfg", "job"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    return f"`python train.py --cfg job`:\n\n```yaml\n{shown.stdout.strip()}\n```\n"


def modules(room: str) -> list[str]:
    """Return the public modules of a room, by their dotted names."""
    paths = sorted((ROOT / "geoskill" / room).rglob("*.py"))
    names = [path.relative_to(ROOT).with_suffix("").parts for path in paths]
    return [".".join(parts) for parts in names if not any(part.startswith("_") for part in parts)]


def api_page(title: str, names: list[str]) -> str:
    """Return a page that documents these modules."""
    parts = [f"# {title}"]
    for name in names:
        parts.append(f"## {name}\n\n```{{eval-rst}}\n.. automodule:: {name}\n```")
    return "\n\n".join(parts) + "\n"


def api_pages() -> dict[str, str]:
    """Return the API pages by the names of their files."""
    pages = {}
    top = [f"geoskill.{name}" for name in TOP_LEVEL if _exists(name)]
    pages["top_level.md"] = api_page("Top level: configuration, plug-ins, errors", top)
    for room, title in ROOMS.items():
        if names := modules(room):
            pages[f"{room}.md"] = api_page(title, names)
    return pages


def _exists(name: str) -> bool:
    package = ROOT / "geoskill"
    return (package / f"{name}.py").is_file() or (package / name / "__init__.py").is_file()


def main() -> None:
    """Write all generated pages, and nothing that was generated before from modules that are gone."""
    shutil.rmtree(GENERATED, ignore_errors=True)
    (GENERATED / "api").mkdir(parents=True)
    (GENERATED / "configuration.md").write_text(configuration(), encoding="utf-8")
    for name, page in api_pages().items():
        (GENERATED / "api" / name).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
