"""Roles that bodies of a scene play in a task."""

from enum import StrEnum
from typing import final


@final
class SceneRole(StrEnum):
    """Role of a body in a task, in order of precedence where bodies with different roles overlap.

    AGENT is whoever moves the object: a person's hand or a robot's gripper.
    """

    OBJECT = "object"
    TARGET = "target"
    AGENT = "agent"
