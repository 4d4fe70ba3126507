"""Paths on the command line: taken as they are written, before Hydra's grammar for values sees them.

Hydra reads ``video=a,b.mp4`` as two values, ``task.path=2024_01_05`` as a number, and ``skill=Bob's run`` not at all.
Values of keys that take a path are quoted here, once and at the door, unless Hydra reads them as the very text.
"""

import re
from collections.abc import Iterable
from pathlib import Path

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Quote, QuotedString
from hydra.errors import HydraException

PATH_KEYS = (
    "task.path",
    "task.regions.path",
    "video",
    "regions.path",
    "skill",
    "definition",
    "intrinsics",
    "ckpt_path",
    "init_from",
    "intrinsics",
    "cache.folder",
    "descriptor.aliked.weights",
    "descriptor.disk.weights",
    "descriptor.xfeat.weights",
    "artifact.data",
    "hydra.run.dir",
    "hydra.sweep.dir",
)
# Groups that are given as the one path in them.
SHORT = {"regions": "regions.path", "task.regions": "task.regions.path"}
QUOTED = re.compile(r"""(?P<quote>['"])(?:\\.|(?!(?P=quote)).)*(?P=quote)""", re.DOTALL)
# Functions of Hydra's grammar that make the values of a sweep.
SWEEP_FUNCTION = re.compile(r"(?:choice|glob|shuffle|sort|tag)\(.*\)", re.DOTALL)


def with_literal_paths(arguments: Iterable[str], *, multirun: bool = False) -> list[str]:
    r"""Return command-line arguments in which the paths are quoted for Hydra where they must be.

    ``regions=PATH`` becomes ``regions.path=PATH``.

    A path that exists is itself, whatever characters it has. Of other values, Hydra's quotes, lists, ``null`` and
    interpolations keep their meaning, and so do the several values of a sweep. ``~`` at the beginning becomes the home
    folder, for shells leave it behind an equals sign. What is returned may be passed again.

    Args:
        arguments: ``KEY=VALUE`` and options.
        multirun: whether they are those of a sweep.

    >>> with_literal_paths(["video=a,b.mp4", "skill=runs/1", "task.path=[1e5,Bob's]", "seed=1e5"])
    ['video="a,b.mp4"', 'skill=runs/1', 'task.path=["1e5","Bob\'s"]', 'seed=1e5']
    >>> with_literal_paths(["video=a (1).mp4,b.mp4"], multirun=True)
    ['video="a (1).mp4",b.mp4']
    """
    literal = []
    for argument in arguments:
        key, equals, value = argument.partition("=")
        key = SHORT.get(key, key) if equals else key
        takes_path = equals and key.lstrip("+") in PATH_KEYS
        literal.append(f"{key}{equals}{_literal(value, multirun) if takes_path else value}")
    return literal


def listed_paths(value: str) -> list[str]:
    """Return the paths of a list, as written on the command line; none of anything else, or of a path that exists.

    >>> listed_paths("[a.mp4,'b,c.mp4']"), listed_paths("a.mp4")
    (['a.mp4', "'b,c.mp4'"], [])
    """
    is_list = value.startswith("[") and value.endswith("]") and not _exists(value)
    return [piece for piece in _pieces(value[1:-1]) if piece] if is_list else []


def _literal(value: str, multirun: bool) -> str:
    if value in ("", "null"):
        return value
    if _exists(value):
        return value if _is_plain(value) and "${" not in value else _quoted(_escaped(value))
    if QUOTED.fullmatch(value) or (multirun and SWEEP_FUNCTION.fullmatch(value)):
        return value
    if multirun:
        values = re.split(r"(?<=\])\s*,\s*(?=\[)", value) if value.startswith("[") else _pieces(value)
        if len(values) > 1:
            return ",".join(_literal(each, multirun=False) for each in values)
    if value.startswith("[") and value.endswith("]"):
        return f"[{','.join(_literal(piece, multirun=False) for piece in _pieces(value[1:-1]))}]"
    expanded = str(Path(value).expanduser()) if value.startswith("~") and _has_home(value) else value
    return expanded if _is_plain(expanded) else _quoted(expanded)


def _pieces(text: str) -> list[str]:
    """Return what commas separate, but names of existing files, and what is quoted, as a whole."""
    parts = text.split(",")
    pieces: list[str] = []
    start = 0
    while start < len(parts):
        for end in range(len(parts), start, -1):
            piece = ",".join(parts[start:end]).strip()
            if end == start + 1 or QUOTED.fullmatch(piece) or _exists(piece):
                break
        pieces.append(piece)
        start = end
    return pieces


def _exists(value: str) -> bool:
    try:
        return value != "" and Path(value).exists()
    except (OSError, ValueError):  # too long, or with a zero byte
        return False


def _has_home(value: str) -> bool:
    try:
        Path(value).expanduser()
    except RuntimeError:  # of a user who has none, or is not known
        return False
    return True


def _is_plain(value: str) -> bool:
    """Return whether Hydra reads a value as its very text, by itself and in a list."""
    if "\\" in value:  # which escapes what follows in a list
        return False
    try:
        override = OverridesParser.create().parse_override(f"key={value}")
        return not override.is_sweep_override() and bool(override.value() == value)
    except HydraException:
        return False


def _escaped(value: str) -> str:
    """Return a text that OmegaConf reads as ``value``, without any interpolation."""
    return re.sub(r"(\\*)\$\{", lambda match: 2 * match[1] + r"\${", value)


def _quoted(value: str) -> str:
    return QuotedString(value, Quote.double).with_quotes()
