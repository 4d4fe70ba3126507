"""Recordings that several tests share."""

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import Any

import pytest

from geoskill.config import ScenarioConfig
from geoskill.simulation.recording import Recording
from geoskill.simulation.scene import RecordingSettings, record
from geoskill.simulation.tasks.task import Task

Recorded = Callable[..., Recording]


@pytest.fixture(scope="session")
def task_named() -> Callable[[str], Task]:
    """Return a function from a task's name to the task."""

    def create(name: str) -> Task:
        task: Task = getattr(import_module(f"geoskill.simulation.tasks.{name}"), name.capitalize())()
        return task

    return create


@pytest.fixture(scope="session")
def recorded(opengl: None, task_named: Callable[[str], Task]) -> Recorded:
    """Return a cached function that renders every 32nd frame: ``recorded("sorting", "human", seed=1)``.

    Its arguments are the task, the episode, the seed, the stride, the actor and further conditions.
    """

    @cache
    def render(
        task: str, episode: str, seed: int = 0, stride: int = 32, actor: str = "human", **difficulties: Any
    ) -> Recording:
        return record(RecordingSettings(task_named(task), ScenarioConfig(actor, **difficulties), seed, episode, stride))

    return render
