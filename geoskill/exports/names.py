"""The names of the exports on the command line."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from geoskill.errors import InputError, shown
from geoskill.exports.exporter import Exporter
from geoskill.exports.mvtb import ToolboxExporter
from geoskill.exports.ros2 import BagExporter
from geoskill.exports.visp import VispExporter

EXPORTERS: Final[Mapping[str, Callable[[Path], Exporter]]] = {
    "ros2": BagExporter,
    "visp": VispExporter,
    "mvtb": ToolboxExporter,
}


def exporters_of(value: Any, folder: Path) -> list[Exporter]:
    """Return the exporters that ``export=`` asks for: a name, or several.

    Args:
        value: of the key.
        folder: of the run.

    Raises:
        InputError: when there is no such export, or it needs packages that are not installed.
    """
    chosen = list(value) if isinstance(value, list | tuple) else [] if value is None else [value]
    for name in chosen:
        if not isinstance(name, str) or name not in EXPORTERS:
            raise InputError(f"export={shown(name)}: expected {', '.join(EXPORTERS)}, or several, [ros2,visp]")
    return [EXPORTERS[name](folder) for name in dict.fromkeys(chosen)]
