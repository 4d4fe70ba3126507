"""The frame in which a task is done."""

from dataclasses import replace
from pathlib import Path

import pytest

from geoskill.cli.end_of_task import EndOfTask
from geoskill.io.frames import Frame
from geoskill.io.image_folder import ImageFolder
from geoskill.model.evidence import Evidence
from geoskill.skill.association import InferenceResult
from geoskill.skill.member_status import State
from geoskill.skill.skill import Skill


@pytest.fixture(scope="module")
def loaded(skill: Path) -> Skill:
    return Skill.load(skill)


@pytest.fixture(scope="module")
def frame(demonstration_folder: Path) -> Frame:
    return next(iter(ImageFolder(demonstration_folder)))


@pytest.fixture(scope="module")
def result(loaded: Skill, frame: Frame) -> InferenceResult:
    selected = loaded.infer(frame.image)
    assert selected.associations
    return selected


def in_state(result: InferenceResult, state: State) -> InferenceResult:
    return replace(result, members={name: replace(own, state=state) for name, own in result.members.items()})


def test_last_frame_at_the_goal_or_else_the_last_with_an_association(frame: Frame, result: InferenceResult) -> None:
    end = EndOfTask()
    assert end.seen is None
    approaching, at_goal = (in_state(result, state) for state in (State.APPROACHING, State.AT_GOAL))
    nothing = replace(approaching, associations=())
    for number, (own, expected) in enumerate(
        [
            (nothing, None),
            (approaching, 1),
            (nothing, 1),
            (approaching, 3),
            (at_goal, 4),
            (approaching, 4),
            (at_goal, 6),
        ]
    ):
        end.add(replace(frame, index=number), own)
        assert (end.seen and end.seen[0].index) == expected


def test_a_member_that_learned_nothing_determines_nothing(loaded: Skill, frame: Frame, result: InferenceResult) -> None:
    end = EndOfTask()
    assert end.decidability(loaded) is None
    sure = tuple(replace(own, confidence=0.9) for own in result.associations)
    end.add(frame, replace(result, associations=sure))

    def learned(share: float) -> Skill:
        member = loaded.members[result.associations[0].member]
        member.set_evidence(Evidence(share, 0.1, 100.0))
        return loaded

    decided = end.decidability(learned(0.9))
    assert decided is not None
    assert decided["one_camera"]["of"] == 4
    assert end.decidability(learned(0.1)) is None
