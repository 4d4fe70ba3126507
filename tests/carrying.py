"""Drawn demonstrations: a hand takes a thing from a table and puts it down, while a person may sway behind it."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np

HEIGHT, WIDTH = 120, 160
FRAMES = 60
# The hand comes, carries, lets go, and is back at rest.
REACHES, TAKES, PUTS, RETURNS = 8, 20, 36, 48
OLD_XY, NEW_XY = (36, 84), (118, 76)
HAND_RADIUS = 6
# From the hand to the center of what it carries.
BELOW_THE_HAND = np.array([0.0, 6.0])


@final
@dataclass(frozen=True)
class Carrying:
    """What happens in a drawn demonstration.

    Attributes:
        taken: whether the thing lies on the table at first; it is in the hand otherwise.
        put: whether it lies on the table in the end.
        person: whether a person stands behind the table, who sways.
        turned: by so many degrees it is turned while it is carried.
        half_size: of the thing, in pixels.
        gain: brightness of the last picture over that of the first.
    """

    taken: bool = True
    put: bool = True
    person: bool = True
    turned: float = 0.0
    half_size: tuple[int, int] = (9, 11)
    gain: float = 1.0


def draw(carrying: Carrying) -> list[np.ndarray]:
    """Return the RGB pictures."""
    random = np.random.default_rng(0)
    table = np.full((HEIGHT, WIDTH, 3), (120, 150, 130), np.float32)
    table[: HEIGHT // 3] = (190, 185, 170)
    table += cv2.GaussianBlur(random.normal(0, 40, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 3)[..., None]
    cv2.ellipse(table, (NEW_XY[0], NEW_XY[1] + 10), (22, 10), 0, 0, 360, (70, 60, 160), -1)
    shirt = cv2.GaussianBlur(random.normal(0, 90, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 1.5)
    print_on_it = random.integers(0, 2, (6, 6)) * 90.0
    frames = []
    for t in range(FRAMES):
        picture = table.copy()
        if carrying.person:
            _draw_person(picture, shirt, t)
        hand = hand_xy(t, carrying)
        if carrying.taken and t < TAKES:
            _draw_thing(picture, OLD_XY, 0.0, carrying, print_on_it)
        elif carrying.put and t >= PUTS:
            _draw_thing(picture, NEW_XY, carrying.turned, carrying, print_on_it)
        else:
            share = np.clip((t - TAKES) / (PUTS - TAKES), 0, 1)
            _draw_thing(picture, tuple(hand + BELOW_THE_HAND), carrying.turned * share, carrying, print_on_it)
        elbow, tip = (80, -20), (round(float(hand[0])), round(float(hand[1])))
        cv2.line(picture, elbow, tip, (90, 60, 50), 7)
        cv2.circle(picture, tip, HAND_RADIUS, (220, 170, 150), -1)
        picture *= 1 + (carrying.gain - 1) * t / (FRAMES - 1)
        picture += random.normal(0, 2, picture.shape)
        frames.append(np.clip(picture, 0, 255).astype(np.uint8))
    return frames


def region(xy: tuple[int, int], carrying: Carrying, degrees: float = 0.0) -> np.ndarray:
    """Return the mask of the thing at a place."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [_corners(xy, degrees, carrying.half_size)], 1)
    return mask > 0


def hand_xy(t: int, carrying: Carrying) -> np.ndarray:
    """Return the center of the hand."""
    rest, end = np.array([70.0, 24.0]), np.array([88.0, 26.0])
    old, new = np.array([OLD_XY[0], OLD_XY[1] - 6.0]), np.array([NEW_XY[0], NEW_XY[1] - 6.0])
    path = [(REACHES, rest if carrying.taken else old), (TAKES, old), (PUTS, new)]
    path += [(RETURNS, end if carrying.put else new)]
    times = [time for time, _ in path]
    place = np.array([np.interp(t, times, [float(xy[axis]) for _, xy in path]) for axis in (0, 1)])
    lift = 18.0 * np.sin(np.pi * np.clip((t - TAKES) / (PUTS - TAKES), 0, 1))
    return np.asarray(place - (0.0, lift))


def _draw_person(picture: np.ndarray, shirt: np.ndarray, t: int) -> None:
    shift = round(2.5 * np.sin(t / 5.0))
    body = slice(60 + shift, 100 + shift)
    picture[: HEIGHT // 3, body] = 80 + np.roll(shirt, shift, axis=1)[: HEIGHT // 3, body, None]


def _corners(xy: tuple[float, float], degrees: float, half_size: tuple[int, int]) -> np.ndarray:
    angle = np.radians(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    ends = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half_size
    return np.asarray((ends @ turn.T + xy).round().astype(np.int32))


def _draw_thing(
    picture: np.ndarray, xy: tuple[float, float], degrees: float, carrying: Carrying, print_on_it: np.ndarray
) -> None:
    width, height = (2 * half + 1 for half in carrying.half_size)
    face = np.full((height, width, 3), (210, 60, 40), np.float32)
    face += cv2.resize(print_on_it.astype(np.float32), (width, height), interpolation=cv2.INTER_NEAREST)[..., None]
    corners = _corners(xy, degrees, carrying.half_size).astype(np.float32)
    source = np.array([[0, 0], [width - 1, 0], [width - 1, height - 1], [0, height - 1]], np.float32)
    warp = cv2.getPerspectiveTransform(source, corners)
    painted = cv2.warpPerspective(face, warp, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.fillPoly(mask, [corners.astype(np.int32)], 1)
    picture[mask > 0] = painted[mask > 0]
