"""What the live interface does with pictures and requests, whatever they come through."""

import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Final, final

import numpy as np

from geoskill.errors import InputError
from geoskill.exports.messages import Kind, Message, Picture, Request
from geoskill.exports.record import NeutralRecord, frame_record, step_record
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.io.frames import size_text
from geoskill.skill.association import InferenceResult
from geoskill.skill.servoing import Servo
from geoskill.skill.skill import Skill

Infer = Callable[[Picture, Mapping[str, FeatureSet] | None, DepthPicture | None], InferenceResult]
MAX_REPORTS: Final = 1000
"""Displacements that wait for the next picture."""
TIMED: Final = 50
"""Last frames over which the latency is told."""


@final
@dataclass(frozen=True, eq=False)
class View:
    """What is seen at one moment.

    Attributes:
        pictures: RGB, one of each camera.
        frame: number.
        time_s: seconds since the beginning.
        taken_at: seconds since 1970, when the picture was taken.
        features: of the first picture, where they have been extracted.
        depth: of the first picture, if any.
    """

    pictures: Sequence[Picture]
    frame: int
    time_s: float
    taken_at: float
    features: Mapping[str, FeatureSet] | None = None
    depth: DepthPicture | None = None


class Watcher(ABC):
    """What looks at one view after another."""

    dofs: Sequence[str] = ()
    """Components of what is commanded; none where nothing is."""

    @abstractmethod
    def look(
        self, view: View, acted: np.ndarray | None, touched: bool
    ) -> tuple[Sequence[InferenceResult], NeutralRecord]:
        """Return what was selected in each picture, and the record.

        Args:
            view: the next one.
            acted: displacement that was carried out since the last one; None where it is not known.
            touched: whether the carried thing has come to rest on something.
        """


@final
class Observer(Watcher):
    """Selects, and commands nothing.

    Args:
        skill: that selects.
        infer: selects over time.
    """

    def __init__(self, skill: Skill, infer: Infer) -> None:
        self._skill, self._infer = skill, infer

    def look(
        self, view: View, acted: np.ndarray | None, touched: bool
    ) -> tuple[Sequence[InferenceResult], NeutralRecord]:
        """See :meth:`Watcher.look`."""
        if len(view.pictures) != 1:
            raise InputError(f"there are {len(view.pictures)} pictures; expected 1")
        result = self._infer(view.pictures[0], view.features, view.depth)
        return [result], frame_record(view.frame, view.time_s, self._skill, result)


@final
class Driver(Watcher):
    """Closes the loop: says how the actor is to move.

    Args:
        servo: before its first step.
        rate_hz: steps per second, for twists.
    """

    def __init__(self, servo: Servo, rate_hz: float) -> None:
        self._servo, self._rate_hz = servo, rate_hz
        self.dofs = [str(dof) for dof in servo.space.dofs]

    def look(
        self, view: View, acted: np.ndarray | None, touched: bool
    ) -> tuple[Sequence[InferenceResult], NeutralRecord]:
        """See :meth:`Watcher.look`."""
        features = None if view.features is None else [view.features]
        self._servo.step(list(view.pictures), acted, touched, features)
        if self._servo.record is None:
            raise RuntimeError("a step without a record")
        record = step_record(self._servo.record, self._servo.space, self._rate_hz)
        return self._servo.results, {**record, "frame": view.frame, "time_s": round(view.time_s, 6)}


@final
@dataclass(frozen=True, eq=False)
class _Report:
    """A displacement that was carried out."""

    acted: np.ndarray
    touched: bool
    time_s: float | None


@final
@dataclass(eq=False)
class _Reports:
    """Displacements that were reported since the last view; safe to use from several threads."""

    waiting: list[_Report] = field(default_factory=list)
    any_so_far: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, report: _Report) -> int:
        """Add one, and return how many are waiting.

        Raises:
            InputError: when too many are waiting.
        """
        with self.lock:
            if len(self.waiting) >= MAX_REPORTS:
                raise InputError(f"{MAX_REPORTS} displacements wait for a picture; expected pictures, too")
            self.waiting.append(report)
            self.any_so_far = True
            return len(self.waiting)

    def until(self, time_s: float, dofs: int) -> tuple[np.ndarray | None, bool]:
        """Return the displacement up to a time, and whether it ended by touch; None before anything was reported."""
        with self.lock:
            due = [own for own in self.waiting if own.time_s is None or own.time_s <= time_s]
            self.waiting = [own for own in self.waiting if own not in due]
            if not self.any_so_far:
                return None, False
            # Who reports at all has not moved where nothing is reported.
            total = np.sum([own.acted for own in due], axis=0) if due else np.zeros(dofs)
            return np.asarray(total, np.float64), bool(due) and due[-1].touched


Write = Callable[[View, Sequence[InferenceResult], NeutralRecord], None]


@final
class LiveSession:
    """Looks at views one after another, and takes reports of what the actor did meanwhile.

    Args:
        new_watcher: makes what looks; called again at every restart.
        write: is told every view with what was found.
        source: name of the video; None where pictures come with requests.
    """

    def __init__(self, new_watcher: Callable[[], Watcher], write: Write, source: str | None = None) -> None:
        self._new_watcher, self._write, self._source = new_watcher, write, source
        self._looking = threading.Lock()
        self._began = time.monotonic()
        self._frames = 0
        self._latencies: deque[float] = deque(maxlen=TIMED)
        self._state = "waiting"
        self._start()

    def _start(self) -> None:
        self._watcher = self._new_watcher()
        self._reports = _Reports()
        self._shape: tuple[int, ...] | None = None

    @property
    def frames(self) -> int:
        """How many views there were."""
        return self._frames

    @property
    def latency_s(self) -> float | None:
        """Median time from when a picture was taken to when its message left, of the last ones; None before any."""
        return median(self._latencies) if self._latencies else None

    def answer(self, request: Request) -> Message:
        """Return the reply to a request.

        Raises:
            InputError: when it cannot be done.
        """
        if request.kind is Kind.STATUS:
            return {"status": self._status()}
        if request.kind is Kind.RESTART:
            with self._looking:
                self._start()
            return {"restarted": True}
        if request.acted is not None:
            self._check(request.acted)
        if request.kind is Kind.ACTED:
            waiting = self._reports.add(_Report(np.array(request.acted), request.touched, request.time_s))
            return {"accepted": True, "waiting": waiting}
        if self._source is not None:
            raise InputError(f"pictures come from {self._source}; expected none, or serve.py without video=")
        return self._frame(request)

    def _frame(self, request: Request) -> Message:
        taken_at = time.time()
        with self._looking:
            time_s = time.monotonic() - self._began if request.time_s is None else request.time_s
            if request.acted is not None:
                self._reports.add(_Report(np.array(request.acted), request.touched, None))
            return self._look(View(request.pictures, self._frames, time_s, taken_at), request.touched)

    def take(self, view: View) -> Message:
        """Return the message of a view of the video."""
        with self._looking:
            return self._look(view, False)

    def _look(self, view: View, touched: bool) -> Message:
        shape = view.pictures[0].shape
        if any(own.shape != (self._shape or shape) for own in view.pictures):
            sizes = ", ".join(size_text(own.shape) for own in view.pictures)
            raise InputError(f"the picture is {sizes}; expected {size_text(self._shape or shape)} (request: restart)")
        self._shape = shape
        acted, rests = self._reports.until(view.time_s, len(self._watcher.dofs))
        results, record = self._watcher.look(view, acted if self._watcher.dofs else None, touched or rests)
        self._write(view, results, record)
        self._frames += 1
        self._state = record["state"]
        message = {**record, "members": members_of(results[0]), "taken_at": round(view.taken_at, 6)}
        sent_at = time.time()
        self._latencies.append(sent_at - view.taken_at)
        return {**message, "sent_at": round(sent_at, 6)}

    def _check(self, acted: Sequence[float]) -> None:
        dofs = self._watcher.dofs
        if not dofs:
            raise InputError("acted: nothing is commanded here; expected serve.py drive=true")
        if len(acted) != len(dofs):
            raise InputError(f"acted has {len(acted)} numbers; expected {len(dofs)}: {', '.join(dofs)}")

    def _status(self) -> Message:
        latency = self.latency_s
        return {
            "frames": self._frames,
            "state": self._state,
            "dof": list(self._watcher.dofs),
            "source": self._source,
            "size": None if self._shape is None else [self._shape[1], self._shape[0]],
            "latency_s": None if latency is None else round(latency, 4),
        }


def members_of(result: InferenceResult) -> Message:
    """Return what is said of each member: state, and error and confidence of its top association."""
    top = {association.member: association for association in result.associations if association.rank == 1}
    members = {}
    for name, status in result.members.items():
        own = top.get(name)
        goal = own.goal if own is not None and status.goal_error_is_certain else None
        members[name] = {
            "state": str(status.state),
            "confidence": 0.0 if own is None else round(own.confidence, 4),
            "error": None if own is None or not status.error_is_certain else [round(value, 4) for value in own.error],
            "goal_error": None if goal is None else [round(value, 4) for value in goal.error],
            "unit": status.unit,
            "reason": result.reasons.get(name, ""),
        }
    return members
