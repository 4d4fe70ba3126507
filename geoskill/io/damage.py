"""Damage to a video: counted, and said when the video has been read, or refused.

A phone's video with a damaged frame, or a stream that lost a packet, is a demonstration all the same. One that is
damaged for longer than a moment is not: what happened in it is not known.
"""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

import av.logging

from geoskill.errors import InputError

LONGEST_MESSAGE = 80
"""Characters of what FFmpeg says that are repeated."""


@final
class Damage:
    """What is wrong with one video while it is decoded, and what FFmpeg reports as errors and makes up for.

    Only messages of the thread that decodes are seen, so the decoder must have no threads of its own.

    Args:
        name: of the video, for messages.
        strict: refuse the video at the first error, and where frames are missing.
        most_in_a_row: more damaged frames than this, one after the other, break the video.
    """

    def __init__(self, name: str, strict: bool, most_in_a_row: int) -> None:
        self._name = name
        self._strict = strict
        self._most_in_a_row = most_in_a_row
        self._errors = 0
        self._damaged, self._in_a_row = 0, 0
        self._first = ""

    @contextmanager
    def watched(self, index: int) -> Iterator[None]:
        """Count the errors that FFmpeg reports in the block.

        Args:
            index: of the next frame.

        Raises:
            InputError: for the first one, if the damage is to be refused.
        """
        av.logging.set_level(av.logging.ERROR)
        av.logging.set_skip_repeated(False)  # which would hide what an earlier reading has reported
        try:
            with av.logging.Capture() as messages:
                yield
        finally:
            av.logging.set_level(None)  # as PyAV has it: threads that report would wait for Python's lock
        for _, _, text in messages:
            self._errors += 1
            self._note(index, " ".join(text.split())[:LONGEST_MESSAGE])

    def take_in(self, index: int, wrong: str | None) -> None:
        """Count a frame.

        Args:
            index: of the frame, or of the next one where it cannot be decoded.
            wrong: what is wrong with it; None where it is whole.

        Raises:
            InputError: for the first damaged one, if the damage is to be refused, and for too many in a row.
        """
        if wrong is None:
            self._in_a_row = 0
            return
        self._damaged, self._in_a_row = self._damaged + 1, self._in_a_row + 1
        self._note(index, wrong)
        if self._in_a_row > self._most_in_a_row:
            raise InputError(
                f"{self._name}: the video breaks at frame {index}: {wrong}; expected a complete video file"
            )

    def _note(self, index: int, wrong: str) -> None:
        self._first = self._first or f"frame {index}: {wrong}"
        if self._strict:
            raise InputError(f"{self._name}: {self._first}; expected a video without damage, or strict_video=false")

    def conclude(self, missing: int, frames: int) -> None:
        """Say what was found, in a warning.

        Args:
            missing: number of frames that the file states and that did not come.
            frames: number of those that came.

        Raises:
            InputError: when frames are missing and the damage is to be refused.
        """
        found = []
        if missing > 0:
            found.append(f"{missing} of {missing + frames} frames are missing")
        if self._strict and found:
            raise InputError(f"{self._name}: {found[0]}; expected a video without damage, or strict_video=false")
        counts = [
            text
            for count, text in (
                (self._damaged, f"{self._damaged} frame(s) are damaged"),
                (self._errors, f"the decoder reports {self._errors} error(s)"),
            )
            if count
        ]
        if counts:
            found.append(f"{', '.join(counts)}, the first at {self._first}")
        if found:
            message = f"{self._name}: {'; '.join(found)}; it is taken as it is (strict_video=true refuses it)"
            warnings.warn(message, stacklevel=2)
