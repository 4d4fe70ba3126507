"""Recordings that several tests look at."""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

import pytest

from geoskill.simulation.conditions import Conditions
from geoskill.simulation.recording import Recording
from geoskill.simulation.scene import RecordingSettings, record
from geoskill.simulation.tasks.task import Task

Recorded = Callable[..., Recording]


@pytest.fixture(scope="session")
def task_called() -> Callable[[str], Task]:
    """``task_called("sorting")`` is the task."""

    def find(name: str) -> Task:
        task: Task = getattr(import_module(f"geoskill.simulation.tasks.{name}"), name.capitalize())()
        return task

    return find


@pytest.fixture(scope="session")
def recorded(opengl: None, task_called: Callable[[str], Task]) -> Recorded:
    """``recorded("sorting", "human", seed=1)`` is every 32nd frame of that take, made once.

    Further arguments are those of the conditions.
    """

    @cache
    def make(task: str, take: str, seed: int = 0, stride: int = 32, actor: str = "human", **hard: Any) -> Recording:
        return record(RecordingSettings(task_called(task), Conditions(actor, **hard), seed, take, stride))

    return make
