"""Pictures of the frames on which a skill was wrong."""

from collections.abc import Sequence
from pathlib import Path
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.evaluation.labels import Labels
from geoskill.evaluation.metrics import FrameResult
from geoskill.evaluation.regions import FrameRegions
from geoskill.io.frames import Frame
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import InferenceResult
from geoskill.viz.overlay import draw_overlay

FOLDER = "failures"
# RGB: what is moved, what it is brought to, and who does it.
COLORS = {SceneRole.OBJECT: (0, 200, 0), SceneRole.TARGET: (0, 120, 255), SceneRole.AGENT: (150, 150, 150)}
JPEG_QUALITY = 85


@final
class FailurePictures:
    """Overlays of wrong frames with the labeled outlines, evenly of all; kept encoded until they are written.

    Args:
        labels: the ground truth.
        most: how many are kept at most.
    """

    def __init__(self, labels: Labels, most: int) -> None:
        self._labels = labels
        self._most = most
        self._stride, self._wrong = 1, 0
        self._kept: dict[int, bytes] = {}

    def __call__(self, frame: Frame, result: InferenceResult, results: Sequence[FrameResult]) -> None:
        """Take in the results of all members on a frame."""
        if self._most == 0 or not any(own.feasible and not own.correct for own in results):
            return
        if self._wrong % self._stride == 0:
            picture = draw_overlay(
                self._outlined(frame), result, frame_index=frame.index, time_s=frame.time_s, title="wrong"
            )
            encoded = cv2.imencode(".jpg", picture[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1]
            self._kept[frame.index] = encoded.tobytes()
        self._wrong += 1
        if len(self._kept) > self._most:  # of twice as many, every second one
            self._stride *= 2
            self._kept = dict(list(self._kept.items())[::2])

    def write(self, run: Path) -> int:
        """Write the pictures into ``run/failures`` and return their number."""
        if self._kept:
            (run / FOLDER).mkdir(exist_ok=True)
        for index, encoded in self._kept.items():
            (run / FOLDER / f"{index:06d}.jpg").write_bytes(encoded)
        return len(self._kept)

    def _outlined(self, frame: Frame) -> UInt8[np.ndarray, "height width 3"]:
        regions = self._labels.at(frame.index)
        image = frame.image.copy()
        if isinstance(regions, FrameRegions):
            for role, color in COLORS.items():
                outlines = [regions.polygons[role], *regions.pieces.get(role, ()), *regions.holes.get(role, ())]
                drawn = [np.rint(outline).astype(np.int32) for outline in outlines if len(outline)]
                cv2.polylines(image, drawn, True, color, 1, cv2.LINE_AA)
        return image
