"""Text files from anybody, bounded in size, and JSON objects of which each key occurs once."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

from geoskill.errors import InputError, shown

# JSON unfolds to some twenty times its size; a thousand frames of hand-labeled polygons take one megabyte.
MAX_BYTES = 20_000_000


def read_text(path: str | Path, expected: str) -> str:
    """Read a file.

    Args:
        path: of the file.
        expected: what it should be, for messages.

    Raises:
        InputError: when there is none, it cannot be read, or it is larger than :data:`MAX_BYTES`.
    """
    try:
        size = Path(path).stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path}: is {size} bytes large; expected {expected} of at most {MAX_BYTES}")
        text = Path(path).read_text(encoding="utf-8-sig")  # without the mark with which some editors begin a file
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected {expected}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected {expected}") from error
    return text


def parse_json(path: str | Path, text: str, expected: str) -> dict[str, Any]:
    """Parse a JSON object, in which each key occurs once.

    Args:
        path: of the file, for messages.
        text: of the file.
        expected: what it should be, for messages.

    Raises:
        InputError: when it is none.
    """
    try:
        content = json.loads(text, object_pairs_hook=_without_duplicates)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); expected {expected}") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {written(content)}; expected an object, as {expected} has it")
    return content


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # Python's reader silently keeps the last of two entries with the same key.
    content = dict(pairs)
    if len(content) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        repeated = next(key for key, count in counts.items() if count > 1)
        raise InputError(f"the key {shown(repeated)} occurs more than once in one object; expected each once")
    return content


def written(value: Any) -> str:
    """Return a value as JSON, shortened."""
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def is_coordinate(value: Any) -> bool:
    """Return whether a value of JSON is a coordinate in pixels, from -1e6 to 1e6."""
    # A polygon may reach beyond the image. The bound refuses NaN, infinity and numbers that overflow float32.
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e6 <= value <= 1e6
