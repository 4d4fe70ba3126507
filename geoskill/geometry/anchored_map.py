"""The map between two pictures of a thing, found through one of its features and what agrees with it.

Of the features around an anchor, some may be matched wrongly, and others belong to something else that moved otherwise:
a background, however many features it has. Every map that is tried takes the anchor to its counterpart; the one that
most of the other features agree with is taken. So the background never outvotes the thing. Nothing is drawn at random.
"""

from dataclasses import dataclass
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import Bool, Complex128, Float64, Int

from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.segments import distance_to_segment

MIN_SUPPORT: Final = 3
"""Features beside the anchor that have to agree: one fixes a similarity, and two may agree by chance."""
TURNED_COST: Final = 2
"""Further features that have to agree where the thing turned or changed its size by more than :data:`SMALL_TURN`."""
SMALL_TURN: Final = 0.15
MIN_AFFINE_SUPPORT: Final = 8
MIN_HOMOGRAPHY_SUPPORT: Final = 16
MAX_SCALE: Final = 2.0
"""Largest change of size; descriptors do not agree beyond it."""
GAIN: Final = 0.8
"""A map with more freedom has to fit with a residual of no more than this share."""
MAX_CROSSING: Final = 30
"""Lines whose crossings with the anchor are tried, the nearest ones."""
SCALES: Final = (0.8, 0.87, 0.93, 1.0, 1.07, 1.15, 1.25)
"""Changes of size that are tried where only lines are known."""


@final
@dataclass(frozen=True, eq=False)
class Matches:
    """Possible matches of features of one type between two pictures.

    Attributes:
        node_type: of all of them.
        source: ``[c, g]``, geometry in the first picture, in pixels.
        target: ``[c, g]``, geometry in the second picture.
        feature: ``[c]``, number of the feature in the second picture; it may have several possible matches.
    """

    node_type: NodeType
    source: Float64[np.ndarray, "c g"]
    target: Float64[np.ndarray, "c g"]
    feature: Int[np.ndarray, " c"]

    def __len__(self) -> int:
        return len(self.source)

    def chosen(self, rows: Bool[np.ndarray, " c"] | Int[np.ndarray, " k"]) -> "Matches":
        """Return some of the matches, by a mask or by their numbers."""
        return Matches(self.node_type, self.source[rows], self.target[rows], self.feature[rows])


def anchored_map(anchor: Matches, others: Matches, tolerance_px: float) -> Float64[np.ndarray, "3 3"] | None:
    """Return the map of the plane that takes the anchor to its counterpart and has the most support.

    It is a similarity; with enough support an affine map or a homography, where these fit clearly better.

    Args:
        anchor: possible matches of one feature.
        others: matches of other features; of points, or of lines with a line as the anchor.
        tolerance_px: distance up to which a feature agrees.

    Returns:
        A matrix for homogeneous pixels, or None where fewer than :data:`MIN_SUPPORT` other features agree.
    """
    slope, shift = _similarities(anchor, others)
    slope, shift = slope[_plausible(slope)], shift[_plausible(slope)]
    if len(slope) == 0:
        return None
    maps = np.zeros((len(slope), 3, 3))
    maps[:, 0, 0] = maps[:, 1, 1] = slope.real
    maps[:, 1, 0], maps[:, 0, 1] = slope.imag, -slope.imag
    maps[:, 0, 2], maps[:, 1, 2], maps[:, 2, 2] = shift.real, shift.imag, 1.0
    held = residuals(maps, anchor).min(axis=1, initial=np.inf) <= tolerance_px
    if not held.any():
        return None
    maps, slope = maps[held], slope[held]
    support = _support(residuals(maps, others) <= tolerance_px, others)
    support -= TURNED_COST * (np.abs(slope - 1) > SMALL_TURN)
    best = int(support.argmax())
    if support[best] < MIN_SUPPORT:
        return None
    return _refined(maps[best], anchor, others, tolerance_px)


def mapped(
    matrix: Float64[np.ndarray, "*h 3 3"], geometry: Float64[np.ndarray, "n g"]
) -> Float64[np.ndarray, "*h n g"]:
    """Return points or segments under maps of the plane, in pixels."""
    points = geometry.reshape(-1, 2)
    homogeneous = points @ np.swapaxes(matrix[..., :2], -1, -2) + matrix[..., None, :, 2]
    result: np.ndarray = homogeneous[..., :2] / homogeneous[..., 2:]
    return result.reshape(*matrix.shape[:-2], *geometry.shape)


def residuals(maps: Float64[np.ndarray, "h 3 3"], matches: Matches) -> Float64[np.ndarray, "h c"]:
    """Return how far each mapped feature is from its counterpart, in pixels.

    Of a line: the larger distance of its end points to the counterpart's carrier; infinite where the two do not
    overlap, since another edge on the same carrier is another line.
    """
    result = mapped(maps, matches.source)
    if matches.node_type is NodeType.POINT:
        distance: np.ndarray = np.linalg.norm(result - matches.target, axis=2)
        return distance
    start, along = matches.target[:, :2], matches.target[:, 2:] - matches.target[:, :2]
    length = np.linalg.norm(along, axis=1)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
    ends = result.reshape(*result.shape[:2], 2, 2)
    across = np.abs(((ends - start[:, None]) * normal[:, None]).sum(axis=3)).max(axis=2)
    beyond = distance_to_segment(ends.mean(axis=2), matches.target)
    half = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2) / 2
    overlap: np.ndarray = np.where(beyond <= half + across, across, np.inf)
    return overlap


def _plausible(slope: Complex128[np.ndarray, " h"]) -> Bool[np.ndarray, " h"]:
    size = np.abs(slope)
    return np.asarray(np.isfinite(size) & (size <= MAX_SCALE) & (size >= 1 / MAX_SCALE))


def _similarities(
    anchor: Matches, others: Matches
) -> tuple[Complex128[np.ndarray, " h"], Complex128[np.ndarray, " h"]]:
    """Return the similarities z -> slope z + shift, pixels as complex numbers, that the matches allow."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if anchor.node_type is NodeType.POINT:
            source, target = _complex(anchor.source)[:, None, 0], _complex(anchor.target)[:, None, 0]
            slope = (_complex(others.source)[:, 0] - source) ** -1 * (_complex(others.target)[:, 0] - target)
            return slope.ravel(), (target - slope * source).ravel()
        if others.node_type is NodeType.POINT:
            source, target = _complex(others.source)[:, 0], _complex(others.target)[:, 0]
            first, second = np.triu_indices(len(source), 1)
            slope = (target[second] - target[first]) / (source[second] - source[first])
            return slope, target[first] - slope * source[first]
        return _similarities_of_lines(anchor, others)


def _similarities_of_lines(
    anchor: Matches, others: Matches
) -> tuple[Complex128[np.ndarray, " h"], Complex128[np.ndarray, " h"]]:
    """Return similarities that take the anchor's carrier to its counterpart's, and where another line crosses it."""
    source, target = _complex(anchor.source)[:, None], _complex(anchor.target)[:, None]
    turn = (target[..., 1] - target[..., 0]) / (source[..., 1] - source[..., 0])
    # A line has no direction; it is taken to have turned by less than a right angle.
    turn = np.where(turn.real < 0, -turn, turn) / np.abs(turn)
    if len(source) == 0:
        return np.zeros(0, np.complex128), np.zeros(0, np.complex128)
    distance = np.abs(_complex(others.source).mean(axis=1) - source.mean())
    near = np.argsort(distance, kind="stable")[:MAX_CROSSING]
    before = _crossings(source, _complex(others.source[near])[None])
    after = _crossings(target, _complex(others.target[near])[None])
    slope = turn[None] * np.array(SCALES)[:, None, None] * np.ones_like(before)[None]
    return slope.ravel(), (after[None] - slope * before[None]).ravel()


def _crossings(
    first: Complex128[np.ndarray, "a 1 2"], second: Complex128[np.ndarray, "1 c 2"]
) -> Complex128[np.ndarray, "a c"]:
    """Return where carriers cross; NaN for less than 20 degrees, at which the crossing is not well determined."""
    along, across = first[..., 1] - first[..., 0], second[..., 1] - second[..., 0]
    sine = (along.conj() * across).imag
    share = ((second[..., 0] - first[..., 0]).conj() * across).imag / sine
    clear = np.abs(sine) > np.sin(np.radians(20)) * np.abs(along) * np.abs(across)
    crossing: np.ndarray = np.where(clear, first[..., 0] + share * along, np.nan)
    return crossing


def _support(agrees: Bool[np.ndarray, "h c"], matches: Matches) -> Int[np.ndarray, " h"]:
    """Return how many different places agree: features at one place, which detectors like to repeat, count once."""
    places = np.round(centers(matches.target) / 2)
    _, place = np.unique(places, axis=0, return_inverse=True)
    at_place = (place[:, None] == np.arange(place.max(initial=-1) + 1)).astype(np.float32)
    support: np.ndarray = (agrees.astype(np.float32) @ at_place > 0).sum(axis=1)
    return support


def _refined(
    matrix: Float64[np.ndarray, "3 3"], anchor: Matches, others: Matches, tolerance_px: float
) -> Float64[np.ndarray, "3 3"]:
    """Return the map fitted to all that agrees with it, where the anchor still does."""

    def holds(candidate: np.ndarray) -> bool:
        return bool(residuals(candidate[None], anchor).min() <= tolerance_px)

    best_anchor = residuals(matrix[None], anchor)[0].argmin()
    pairs = [(anchor, np.arange(len(anchor)) == best_anchor)]
    for _ in range(2):
        inliers = residuals(matrix[None], others)[0] <= tolerance_px
        candidate = _least_squares([*pairs, (others, inliers)], affine=False)
        if candidate is None or not holds(candidate):
            break
        matrix = candidate
    inliers = residuals(matrix[None], others)[0] <= tolerance_px
    support = int(_support(inliers[None], others)[0])

    def spread(candidate: np.ndarray) -> float:
        return float(np.sqrt(np.mean(residuals(candidate[None], others)[0][inliers] ** 2)))

    if support >= MIN_AFFINE_SUPPORT:
        candidate = _least_squares([*pairs, (others, inliers)], affine=True)
        if candidate is not None and holds(candidate) and spread(candidate) < GAIN * spread(matrix):
            matrix = candidate
    if support >= MIN_HOMOGRAPHY_SUPPORT and others.node_type is NodeType.POINT:
        bent, _ = cv2.findHomography(others.source[inliers], others.target[inliers], 0)
        if bent is not None and holds(bent) and spread(bent) < GAIN * spread(matrix):
            matrix = bent
    return matrix


def _least_squares(
    chosen: list[tuple[Matches, Bool[np.ndarray, " _"]]], affine: bool
) -> Float64[np.ndarray, "3 3"] | None:
    """Return the similarity or affine map with the smallest squared residuals; None where it is not determined."""
    rows, values = [], []
    for matches, mask in chosen:
        source, target = matches.source[mask], matches.target[mask]
        if matches.node_type is NodeType.POINT:
            normals, points = np.tile(np.eye(2), (len(source), 1)), source.repeat(2, axis=0)
            values.append(target.ravel())
        else:
            along = target[:, 2:] - target[:, :2]
            normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1, keepdims=True)
            normals, points = normal.repeat(2, axis=0), source.reshape(-1, 2)
            values.append((normal * target[:, :2]).sum(axis=1).repeat(2))
        (x, y), (u, v) = points.T, normals.T
        linear = [u * x, u * y, v * x, v * y] if affine else [u * x + v * y, v * x - u * y]
        rows.append(np.stack([*linear, u, v], axis=1))
    equations, wanted = np.concatenate(rows), np.concatenate(values)
    scale = np.abs(equations).max(axis=0)
    solution, _, rank, _ = np.linalg.lstsq(equations / scale, wanted, rcond=1e-6)
    if rank < equations.shape[1]:
        return None
    *linear, right, down = solution / scale
    upper = linear if affine else [linear[0], -linear[1], linear[1], linear[0]]
    return np.array([[*upper[:2], right], [*upper[2:], down], [0.0, 0.0, 1.0]])


def _complex(geometry: Float64[np.ndarray, "n g"]) -> Complex128[np.ndarray, "n e"]:
    ends = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2)
    return np.asarray(ends[..., 0] + 1j * ends[..., 1], np.complex128)
