"""Which of several recordings in one file or folder is meant."""

from dataclasses import dataclass
from typing import final

from geoskill.errors import InputError


@final
@dataclass(frozen=True)
class Choice:
    """One of the recordings in a data set or a bag. What is None is found where there is only one.

    Attributes:
        episode: number of the episode in a LeRobot data set.
        camera: name of the camera there, such as ``observation.images.front``.
        topic: image topic in a bag of ROS 2.
        prefix: what precedes these names where the user gives them, for messages.
    """

    episode: int | None = None
    camera: str | None = None
    topic: str | None = None
    prefix: str = ""

    def require_unused(self, name: str, *keys: str) -> None:
        """Raise InputError where one of these keys is given, for a recording that has no such choice."""
        for key in keys:
            value = getattr(self, key)
            if value is not None:
                kind = "a bag of ROS 2 (MCAP)" if key == "topic" else "a LeRobot data set"
                raise InputError(f"{self.prefix}{key}={value}: {name} is not {kind}; expected no {self.prefix}{key}")
