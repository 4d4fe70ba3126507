"""Damage to a video that its decoder makes up for: counted, and said when the video has been read, or refused."""

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
    """What FFmpeg reports as errors while one video is decoded, and goes on all the same.

    Only messages of the thread that decodes are seen, so the decoder must have no threads of its own.

    Args:
        name: of the video, for messages.
        strict: refuse the video at the first error, and where frames are missing.
    """

    def __init__(self, name: str, strict: bool) -> None:
        self._name = name
        self._strict = strict
        self._errors = 0
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
            self._first = self._first or f"frame {index}: {' '.join(text.split())[:LONGEST_MESSAGE]}"
        if self._strict and messages:
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
        if self._errors:
            found.append(f"the decoder reports {self._errors} error(s), the first at {self._first}")
        if found:
            message = f"{self._name}: {'; '.join(found)}; it is taken as it is (strict_video=true refuses it)"
            warnings.warn(message, stacklevel=2)
