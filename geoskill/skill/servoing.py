"""A skill that closes the loop: pictures in, the actor's next movement out."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.control.action import ActionSpace, Limits, action_space
from geoskill.control.rows import Constraint
from geoskill.control.sequence import Phase
from geoskill.control.servo import initial_state, step
from geoskill.control.settings import ServoConfig
from geoskill.control.state import Decision, Followed, Record, ServoState, Setup, Sighting, limits_of
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, InferenceResult, NodeRole
from geoskill.skill.build import SkillComponents
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter
from geoskill.tracking.flow import track_sparse
from geoskill.tuning import TemporalFilterConfig

LISTED: Final = 60
"""Associations listed per member: the ten best often share a few carried features (docs/experiments/control.md)."""
MAX_DRIVING: Final = 12
"""Associations of a member that drive."""

Picture = UInt8[np.ndarray, "height width 3"]


@final
class FeatureFollower:
    """Features of one camera's pictures, followed from each picture to the next."""

    def __init__(self) -> None:
        self._last: UInt8[np.ndarray, "height width"] | None = None

    def follow(self, frame: Picture, features: Sequence[FeatureSet]) -> Followed:
        """Return the features of a picture, and where they were in the one before; none in the first picture.

        A line is its ends and its middle. Features are followed backward, so that those that were found now are kept.
        """
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        last, self._last = self._last, gray
        if last is None or last.shape != gray.shape:
            return Followed.none()
        points = np.concatenate([np.zeros((0, 2), np.float32), *(_points_of(own) for own in features)])
        before, tracked = track_sparse(NodeType.POINT, points, gray, last)
        return Followed(before[tracked].astype(np.float64), points[tracked].astype(np.float64))


def _points_of(features: FeatureSet) -> Float32[np.ndarray, "p 2"]:
    if features.node_type is NodeType.POINT:
        return features.geometry
    ends = features.geometry.reshape(-1, 2, 2)
    return np.concatenate([ends, ends.mean(axis=1, keepdims=True)], axis=1).reshape(-1, 2)


def listing(skill: Skill, count: int = LISTED) -> Skill:
    """Return the skill with more associations listed per member, at least as many as before."""
    if skill.top_k >= count:
        return skill
    components = SkillComponents(dict(skill.members), dict(skill.pipelines))
    return Skill(components, replace(skill.spec, top_k=count), skill.provenance, skill.pins)


def constraints_of(skill: Skill, result: InferenceResult, camera: int = 0) -> list[Constraint]:
    """Return the associations of a picture that are to drive, as the control law takes them.

    Each set of carried features once, by its best association: others of the same ones say nothing about the angle.
    Where the goals of a member's associations are known, what is left until there is to become zero, not the error, and
    those without a goal do not drive (docs/experiments/control.md).

    Args:
        skill: that selected them.
        result: of the picture.
        camera: number of the picture.
    """
    constraints: list[Constraint] = []
    for name, member in skill.members.items():
        if member.kernel.in_space:  # whose errors are no pixels: the field of the picture says nothing about them
            continue
        own = [association for association in result.associations if association.member == name]
        with_goal = [association for association in own if association.goal is not None]
        for rank, association in enumerate(_distinct(with_goal or own)[:MAX_DRIVING], start=1):
            goal = association.goal
            constraints.append(
                Constraint(
                    member.kernel,
                    tuple(np.array(node.coordinates, np.float64) for node in association.nodes),
                    _carried(association),
                    association.confidence,
                    None if goal is None else tuple(np.subtract(association.error, goal.error).tolist()),
                    camera,
                    name,
                    rank,
                )
            )
    return constraints


def _distinct(associations: Sequence[Association]) -> list[Association]:
    """Return the first association of every set of carried features."""
    found: dict[tuple[tuple[float, ...], ...], Association] = {}
    for own in associations:
        nodes = zip(own.nodes, _carried(own), strict=True)
        # Segments may be directed either way; their middles are the same.
        found.setdefault(tuple(node.center for node, carried in nodes if carried), own)
    return list(found.values())


def _carried(association: Association) -> tuple[bool, ...]:
    """Return which nodes are expected to move: as learned, or else the first."""
    roles = [node.role for node in association.nodes]
    if None in roles:
        return tuple(index == 0 for index in range(len(roles)))
    return tuple(role is NodeRole.MOVING for role in roles)


@final
class Servo:
    """The loop for a robot: it is given pictures, and says how the actor is to move.

    It begins with small probing moves along and about every axis, by which it learns how the picture moves; no
    calibration is needed. The actor holds the thing already.

    Args:
        skill: what is to be done.
        limits: of one step and of the whole way; None for those of the settings.
        dof: `descent`, `xyzy` or `xyzabc`; all but the first want two cameras.
        cameras: number of pictures in each step.
        config: settings; None for the defaults.
        phases: of the task; none to drive all members at once.
        selection: how the skill selects over time; None for the defaults.

    Attributes:
        record: of the last step; None before the first.
        results: what was selected in the pictures of the last step.

    Raises:
        InputError: when there is no such ``dof``, or no camera.
    """

    def __init__(
        self,
        skill: Skill,
        limits: Limits | None = None,
        *,
        dof: str = "descent",
        cameras: int = 1,
        config: ServoConfig | None = None,
        phases: Sequence[Phase] = (),
        selection: TemporalFilterConfig | None = None,
    ) -> None:
        self._skill = skill = listing(skill)
        self._config = ServoConfig() if config is None else config
        if cameras < 1:
            raise InputError(f"cameras={cameras}: expected at least 1")
        try:
            space = action_space(dof, limits_of(self._config) if limits is None else limits)
        except ValueError as error:
            raise InputError(str(error)) from error
        self._setup = Setup(space, self._config, ((0, 0),) * cameras, guarded=dof == "descent", phases=tuple(phases))
        self._state: ServoState | None = None
        self._filters = [TemporalFilter(skill, selection) for _ in range(cameras)]
        self._followers = [FeatureFollower() for _ in range(cameras)]
        self.record: Record | None = None
        self.results: Sequence[InferenceResult] = ()

    @property
    def space(self) -> ActionSpace:
        """What is commanded, with its limits."""
        return self._setup.space

    def step(
        self,
        frame: Picture | Sequence[Picture],
        acted: Sequence[float] | np.ndarray | None = None,
        touched: bool = False,
        features: Sequence[Mapping[str, FeatureSet]] | None = None,
    ) -> Decision:
        """Return what the actor is to do next.

        Args:
            frame: RGB picture, or one of each camera.
            acted: displacement that was carried out since the last picture, in the order of the degrees of freedom:
                meters, and radians about the grip; None where the robot does not tell, so that the command is believed.
            touched: whether the thing has come to rest on something.
            features: of each picture (:meth:`Skill.extract`), where they have been extracted already.

        Raises:
            InputError: when there are not as many pictures as cameras, or one is no picture.
        """
        frames = [frame] if isinstance(frame, np.ndarray) else list(frame)
        if len(frames) != len(self._filters):
            raise InputError(f"there are {len(frames)} pictures; expected {len(self._filters)}, one of each camera")
        given: Sequence[Mapping[str, FeatureSet] | None] = [None] * len(frames) if features is None else features
        seen = zip(self._filters, frames, given, strict=True)
        results = [own.infer(picture, extracted) for own, picture, extracted in seen]
        self.results = results
        if self._state is None:
            sizes = tuple((picture.shape[1], picture.shape[0]) for picture in frames)
            self._setup = Setup(
                self._setup.space, self._config, sizes, guarded=self._setup.guarded, phases=self._setup.phases
            )
            self._state = initial_state(self._setup)
        done = np.asarray(acted, np.float64).reshape(-1) if acted is not None else self._state.command
        sighting = Sighting(
            list(self._constraints(results)),
            [
                own.follow(picture, list(result.features.values()))
                for own, picture, result in zip(self._followers, frames, results, strict=True)
            ],
            done,
            touched,
        )
        decision, self._state, self.record = step(self._setup, self._state, sighting)
        return decision

    def _constraints(self, results: Sequence[InferenceResult]) -> Iterator[Constraint]:
        for camera, result in enumerate(results):
            yield from constraints_of(self._skill, result, camera)
