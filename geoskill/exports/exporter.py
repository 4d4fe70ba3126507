"""The files for other programs that a run writes, each a view of its neutral records."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, final

from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.record import NeutralRecord


class Exporter(ABC):
    """Writes one file; a context, at whose end the file is complete, and after an error not there."""

    @abstractmethod
    def __enter__(self) -> "Exporter":
        """Begin the file."""

    @abstractmethod
    def __exit__(self, *error: object) -> None:
        """End the file, or leave nothing after an error."""

    @abstractmethod
    def add(
        self,
        record: NeutralRecord,
        associations: Sequence[Mapping[str, Any]] = (),
        motion: IntrinsicMotion | None = None,
    ) -> None:
        """Take in the next frame.

        Args:
            record: of the frame.
            associations: the frame's lines of ``associations.jsonl``.
            motion: field of the frame's camera; None where the camera is not known.
        """


@final
class Exports:
    """Several exporters, told at once.

    Args:
        exporters: that have begun.
    """

    def __init__(self, exporters: Sequence[Exporter]) -> None:
        self._exporters = exporters

    def add(
        self,
        record: NeutralRecord,
        associations: Sequence[Mapping[str, Any]] = (),
        motion: IntrinsicMotion | None = None,
    ) -> None:
        """Take in the next frame; see :meth:`Exporter.add`."""
        for exporter in self._exporters:
            exporter.add(record, associations, motion)


@contextmanager
def open_exports(exporters: Sequence[Exporter]) -> Iterator[Exports]:
    """Begin some files, which are complete at the end of the block."""
    with ExitStack() as stack:
        yield Exports([stack.enter_context(exporter) for exporter in exporters])


def finite(value: Any) -> Any:
    """Return a value of JSON with None for numbers that are none, which JSON does not know."""
    if isinstance(value, float):
        return value if value - value == 0 else None
    if isinstance(value, dict):
        return {key: finite(own) for key, own in value.items()}
    return [finite(own) for own in value] if isinstance(value, list | tuple) else value
