"""Roles that the things of a scene play in a task."""

from enum import StrEnum
from typing import final


@final
class SceneRole(StrEnum):
    """SceneRole of a thing in a task, in the order in which overlapping things take precedence.

    AGENT is whoever moves the object: a person's hand or a robot's gripper.
    """

    OBJECT = "object"
    TARGET = "target"
    AGENT = "agent"
