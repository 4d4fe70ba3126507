"""Values of YAML and JSON files as the text of a page."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any


def rounded(values: Sequence[float]) -> list[float | None]:
    """Return numbers for JSON, which knows no NaN."""
    return [None if value != value else round(value, 4) for value in values]


def pairs(values: Any, prefix: str = "") -> list[tuple[str, str]]:
    """Return names and values as text; what is nested is named by dots, and empty values are left out."""
    if not isinstance(values, Mapping):
        return [] if values is None else [(prefix.rstrip("."), _shown(values))]
    return [pair for name, value in values.items() for pair in _named(f"{prefix}{name}", value)]


def _named(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping):
        yield from pairs(value, f"{name}.")
    elif value not in (None, "", []) and not (isinstance(value, list) and any(isinstance(own, list) for own in value)):
        yield name.replace("_", " "), _shown(value)


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return ", ".join(map(_shown, value)) if isinstance(value, list | tuple) else str(value)


def with_unit(value: Any, entry: Mapping[str, Any]) -> str | None:
    """Return a number with the unit of its member; None where it is no number."""
    return None if not isinstance(value, int | float) else f"{value:.3g} {entry.get('unit', '')}".rstrip()


def percent(value: Any) -> str | None:
    """Return a share in percent; None where it is no number."""
    return f"{100 * value:.0f} %" if isinstance(value, int | float) else None


def as_mapping(value: Any) -> Mapping[str, Any]:
    """Return a mapping, an empty one in place of anything else."""
    return value if isinstance(value, Mapping) else {}
