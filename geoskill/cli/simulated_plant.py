"""A rendered scene as a plant: the stage shows what has become of the actor's movements, and a skill looks at it."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, final

import numpy as np

from geoskill.cli.command import Run
from geoskill.cli.inputs import load_skill, open_disk_cache
from geoskill.cli.schemas import ServoCommandConfig
from geoskill.cli.tracked_pairs import TrackedPairs
from geoskill.control.action import Action, ActionSpace, Dof, action_space
from geoskill.control.camera_motion import CameraMotion, constant_depth
from geoskill.control.image_motion import Points
from geoskill.control.plant import Placement, Plant
from geoskill.control.points_plant import ACTUATION, carried_out
from geoskill.control.rows import Constraint
from geoskill.control.sequence import Phase
from geoskill.control.state import Followed, Sighting, limits_of
from geoskill.errors import InputError
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.camera import back_project, project
from geoskill.geometry.poses import Pose, inverse, pose, rotation_about, rotation_vector, transform
from geoskill.plugins import EXTRACTORS, KERNELS, TASKS
from geoskill.simulation.ground_truth import FrameGroundTruth
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.stage import Stage
from geoskill.skill.association import InferenceResult
from geoskill.skill.servoing import FeatureFollower, constraints_of, listing
from geoskill.skill.temporal_filter import TemporalFilter

if TYPE_CHECKING:
    from geoskill.skill.skill import Skill

PAIRS: Final = 8
"""Pairs by the ground truth."""
STEP_S: Final = 0.1
RELEASED_S: Final = 1.0
MARGIN_PX: Final = 30
BLOCKED_M: Final = 0.002
"""Way to the side after which the way down is tried again."""


@final
class SimulatedPlants:
    """The trials of a benchmark on rendered scenes.

    Args:
        config: of the command.
        run: that it is.
    """

    def __init__(self, config: ServoCommandConfig, run: Run) -> None:
        self._config = config
        self._skill: Skill | None = None
        if config.select in ("skill", "top") and config.controller.name != "truth":
            self._skill = listing(
                load_skill(config.skill, config.device, None, open_disk_cache(config.cache), config.definition)
            )
        scene = None if self._skill is None else self._skill.provenance.scene
        # Things look as in the demonstration; where they are is another matter.
        self._looks = 0 if scene is None else scene.seed

    @property
    def phases(self) -> tuple[Phase, ...]:
        """Those that the skill has learned, if it is to keep to them."""
        return () if self._skill is None or self._config.phases == "none" else self._skill.phases

    @contextmanager
    def trial(self, number: int) -> Iterator["ScenePlant"]:
        """Open the scene of a trial."""
        config = self._config
        episode = f"servo {number}" if config.seed == 0 else f"servo {number}, {config.seed}"
        task, two, contact = TASKS.build(config.task.name, {})(), config.cameras == 2, config.plant.contact
        try:
            stage = Stage(task, config.scenario, self._looks, episode, second_camera=two, contact=contact)
        except InputError as error:
            raise InputError(f"{error}; or plant.contact=false" if contact else str(error)) from error
        with stage:
            yield ScenePlant(config, stage, self._skill, np.random.default_rng([config.seed, number]))


@final
class ScenePlant(Plant):
    """One trial in a rendered scene.

    Args:
        config: of the command.
        stage: with the thing anywhere; it is put somewhere near its goal.
        skill: that selects; None to select by the ground truth.
        rng: draws the start and the errors of the actor.
    """

    def __init__(
        self, config: ServoCommandConfig, stage: Stage, skill: "Skill | None", rng: np.random.Generator
    ) -> None:
        self._config, self._stage, self._skill, self._rng = config, stage, skill, rng
        self._space: ActionSpace = action_space(config.dof, limits_of(config.servo))
        self._cameras = stage.cameras
        self._followers = [FeatureFollower() for _ in self._cameras]
        self._trackers = [TrackedPairs() for _ in self._cameras]
        self._filters = [] if skill is None else [TemporalFilter(skill) for _ in self._cameras]
        sift = EXTRACTORS.build("sift", {})()
        self._pipeline = FeaturePipeline(sift, max_features=60, min_side=480)
        self._acted: Action | None = None
        self._blocked_at: Pose | None = None
        self._object = next(part.body for part in stage.roles if part.role is SceneRole.OBJECT)
        start = self._start()
        stage.put(start)
        self._upright = start[:3, :3]
        self.pictures: list[np.ndarray] = []

    def _start(self) -> Pose:
        """Draw a pose 10 to 20 cm and up to 30 degrees from the goal, in all pictures."""
        goal, rng = self._stage.scene.goal, self._rng
        while True:
            distance, bearing = rng.uniform(0.10, 0.20), rng.uniform(-math.pi, math.pi)
            rise = rng.uniform(0.05, 0.09)
            flat = math.sqrt(distance**2 - rise**2)
            shift = np.array([flat * math.cos(bearing), flat * math.sin(bearing), rise])
            turn = rotation_about(np.array([0.0, 0.0, rng.uniform(-1, 1) * math.radians(30)]))
            start = pose(goal[:3, 3] + shift, turn @ goal[:3, :3])
            corners = transform(start, np.array([[x, y, 0.0] for x in (-0.08, 0.08) for y in (-0.08, 0.08)]))
            if all(self._shows(name, corners) for name in self._cameras):
                return start

    def _shows(self, camera: str, points: np.ndarray) -> bool:
        view = self._stage.view(camera)
        pixels, _ = project(view, points)
        upper = np.array([view.width, view.height]) - MARGIN_PX
        return bool((pixels > MARGIN_PX).all() and (pixels < upper).all())

    @property
    def pose(self) -> Pose:
        """Where the thing is."""
        return np.asarray(self._stage.poses()[self._stage.bodies().index(self._object)])

    @property
    def _grip(self) -> np.ndarray:
        return np.asarray((self.pose @ self._stage.scene.grip.pose)[:3, 3])

    def look(self) -> Sighting:
        """See :meth:`Plant.look`."""
        constraints: list[Constraint] = []
        followed: list[Followed] = []
        for camera, name in enumerate(self._cameras):
            frame = self._stage.picture(name)
            if camera == 0:
                self.pictures.append(frame)
            if self._skill is not None:
                result = self._filters[camera].infer(frame)
                constraints += self._selected(result, camera)
                features = list(result.features.values())
            else:
                features = [self._pipeline.extract(frame)]
                pairs = self._by_truth(camera, name, features[0].geometry)
                constraints += (
                    self._trackers[camera].advance(frame, pairs) if self._config.select == "tracked" else pairs
                )
            followed.append(self._followers[camera].follow(frame, features))
        return Sighting(constraints, followed, self._acted, self._touches(), self._motions())

    def _selected(self, result: InferenceResult, camera: int) -> list[Constraint]:
        """Return what the skill selected; with `select=top`, its best association alone and as it is."""
        assert self._skill is not None
        if self._config.select != "top":
            return constraints_of(self._skill, result, camera)
        name = next(iter(self._skill.members))
        best = [own for own in result.associations if own.member == name][:1]
        alone = constraints_of(self._skill, replace(result, associations=tuple(best)), camera)
        return [replace(own, target=None) for own in alone]

    def _by_truth(self, camera: int, name: str, geometry: np.ndarray) -> list[Constraint]:
        """Return pairs of detected features that meet best at the goal, or each carried one with its place there."""
        truth = FrameGroundTruth(self._stage.shot(name), 0)
        pixels = geometry.astype(np.float64)
        points = truth.at(np.rint(geometry).astype(int))
        carried = [index for index, own in enumerate(points) if own and own.role is SceneRole.OBJECT]
        resting = [index for index, own in enumerate(points) if own and own.role is SceneRole.TARGET]
        if not carried:
            return []
        view = self._stage.view(name)
        in_body = transform(inverse(self.pose), self._in_world(name, pixels[carried]))
        goals = project(view, transform(self._stage.scene.goal, in_body))[0]
        kernel = KERNELS.build("p2p", {})()
        if self._config.controller.name == "truth":
            return [
                Constraint(kernel, (pixels[own], goal), (True, False), camera=camera, member="truth", rank=rank)
                for rank, (own, goal) in enumerate(zip(carried, goals, strict=True), start=1)
            ]
        if not resting:
            return []
        distances = np.linalg.norm(goals[:, None] - pixels[resting][None], axis=2)
        constraints: list[Constraint] = []
        while len(constraints) < PAIRS and np.isfinite(distances).any():
            row, column = np.unravel_index(int(np.argmin(distances)), distances.shape)
            nodes = (pixels[carried[row]], pixels[resting[column]])
            rank = len(constraints) + 1
            constraints.append(Constraint(kernel, nodes, (True, False), camera=camera, member="truth", rank=rank))
            distances[row], distances[:, column] = np.inf, np.inf
        return constraints

    def _depths(self, name: str, points: Points) -> np.ndarray:
        depth = self._stage.depth_m(name)
        height, width = depth.shape
        columns, rows = np.rint(np.clip(points, 0, [width - 1, height - 1])).astype(int).T
        return np.asarray(depth[rows, columns], np.float64)

    def _in_world(self, name: str, points: Points) -> np.ndarray:
        return back_project(self._stage.view(name), points, self._depths(name, points))

    def _motions(self) -> list[CameraMotion] | None:
        known = self._config.controller.name
        if known not in ("truth", "calibrated"):
            return None
        motions = []
        for name in self._cameras:
            view = self._stage.view(name)
            rough = constant_depth(float(project(view, self.pose[None, :3, 3])[1][0]))
            exact = partial(self._depths, name)
            motions.append(CameraMotion(view, self._space, self._grip, exact if known == "truth" else rough))
        return motions

    def act(self, action: Action) -> None:
        """See :meth:`Plant.act`."""
        before, grip = self.pose, self._grip
        wanted = action * (1 + ACTUATION * self._rng.normal(size=len(action)))
        target, _ = carried_out(before, grip, self._space.basis @ wanted)
        if Dof.ROLL not in self._space.dofs:  # the grip stays upright, however the thing is pressed
            yaw = float(rotation_vector(target[:3, :3] @ self._upright.T)[2])
            target[:3, :3] = rotation_about(np.array([0.0, 0.0, yaw])) @ self._upright
        floor = self._stage.scene.goal[2, 3]
        if self._config.dof == "descent" and not self._config.plant.contact:
            target[2, 3] = max(target[2, 3], floor)
        self._stage.lead(target, seconds=STEP_S)
        turn = rotation_vector(self.pose[:3, :3] @ before[:3, :3].T)
        done = np.concatenate([self._grip - grip, turn])
        self._acted = self._space.basis.T @ done
        z = self._space.index(Dof.Z)
        if z is not None and action[z] < 0:
            fell_short = self._acted[z] > 0.5 * action[z]
            self._blocked_at = self.pose if fell_short else None

    def _touches(self) -> bool:
        """Return whether the last attempt to go down was stopped, here."""
        if self._blocked_at is None:
            return False
        aside = float(np.linalg.norm(self.pose[:2, 3] - self._blocked_at[:2, 3]))
        return not self._config.plant.contact or aside < BLOCKED_M

    def released(self) -> Placement:
        """See :meth:`Plant.released`; without contact the thing stays where it is."""
        if self._config.plant.contact:
            self._stage.lead(self.pose, held=False, opening=1.0, seconds=RELEASED_S)
        return self.placement()

    def placement(self) -> Placement:
        """See :meth:`Plant.placement`."""
        own = self._stage.distance_to_goal()
        return Placement(own.mm, own.along_mm, own.across_mm, own.deg)
