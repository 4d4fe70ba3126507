"""Pictures on the surfaces of things, drawn at random: prints, wood, felt, cloth, metal, skin.

All are RGB and as high as wide, :data:`SIZE`. Grain of several scales lies over each, since no real surface is of one
color.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Texture = UInt8[np.ndarray, "height width 3"]
Color = Sequence[float]  # red, green, blue

SIZE = 512


def print_on_card(random: np.random.Generator, paper: Color, shapes: int = 26, contrast: float = 1.0) -> Texture:
    """A printed card: shapes and letters, dark and colored, on light paper; rich in corners.

    Args:
        random: draws it.
        paper: its ground, RGB in 0 to 255.
        shapes: how many.
        contrast: of the shapes to the paper, from 0 to 1.
    """
    image = np.full((SIZE, SIZE, 3), paper, np.uint8)
    for _ in range(shapes):
        color = np.array(paper) * (1 - contrast) + contrast * random.uniform(0, 200, 3) * random.choice([0.25, 1.0])
        _draw_shape(image, random, tuple(map(float, color)))
    cv2.rectangle(image, (6, 6), (SIZE - 7, SIZE - 7), (40.0, 40.0, 50.0), 8, cv2.LINE_AA)
    return _grained(image, random, 3.0)


def wood(random: np.random.Generator, color: Color, contrast: float = 12.0) -> Texture:
    """Boards with a soft grain along x."""
    rows = np.cumsum(random.normal(0, 1, SIZE))
    rows = (rows - cv2.GaussianBlur(rows[:, None], (1, 101), 30)[:, 0]) / 4
    wave = _smooth_noise(random, 128) * 20
    places = np.clip(np.arange(SIZE)[:, None] + wave, 0, SIZE - 1).astype(int)
    shade = np.clip(rows[places], -2, 2) * contrast / 2 + _smooth_noise(random, 64) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], random, 2.0)


def felt(random: np.random.Generator, color: Color, contrast: float = 6.0) -> Texture:
    """A plain cloth of short fibres, with large soft stains."""
    shade = _smooth_noise(random, 96) * contrast + _smooth_noise(random, 4) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], random, 4.0)


def stone(random: np.random.Generator, color: Color, contrast: float = 14.0) -> Texture:
    """A worktop of speckles."""
    shade = _smooth_noise(random, 3) * contrast + _smooth_noise(random, 24) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], random, 3.0)


def printed_cloth(random: np.random.Generator, ground: Color) -> Texture:
    """A tea towel: a woven ground with stripes and scattered small prints."""
    image = np.full((SIZE, SIZE, 3), ground, np.uint8)
    stripe = (np.array(ground) + random.uniform(30, 150, 3)) / 2
    for place in (0.06, 0.12, 0.88, 0.94):
        start = int(place * SIZE)
        image[:, start : start + 10] = stripe.astype(np.uint8)
    for _ in range(46):
        color = random.uniform(20, 170, 3)
        _draw_shape(image, random, tuple(map(float, color)), largest=0.07)
    weave = 5 * np.sin(np.arange(SIZE) * np.pi / 2)
    return _grained(image + weave[:, None, None] + weave[None, :, None], random, 3.0)


def striped_print(
    random: np.random.Generator, paper: Color, along: Sequence[float], across: Sequence[float], shapes: int = 130
) -> Texture:
    """A printed sheet of small shapes, and over them straight stripes from edge to edge.

    Args:
        random: draws it.
        paper: its ground, RGB in 0 to 255.
        along: where the upright stripes are, as shares of the width from the left.
        across: where the level stripes are, as shares of the height from the top.
        shapes: how many.
    """
    image = np.full((SIZE, SIZE, 3), paper, np.uint8)
    for _ in range(shapes):
        color = random.uniform(0, 200, 3) * random.choice([0.25, 1.0])
        _draw_shape(image, random, tuple(map(float, color)), largest=0.05)
    half = SIZE // 70
    # Ground is left clear beside the stripes, whose edges are to be seen as lines.
    for width, ink in ((2 * half, np.array(paper)), (half, random.uniform(10, 110, 3))):
        for middle in along:
            image[:, round(middle * SIZE) - width : round(middle * SIZE) + width] = ink
        for middle in across:
            image[round(middle * SIZE) - width : round(middle * SIZE) + width] = ink
    return _grained(image, random, 3.0)


def metal(random: np.random.Generator, color: Color) -> Texture:
    """Brushed sheet metal: fine streaks along x."""
    streaks = cv2.GaussianBlur(random.normal(0, 1, (SIZE, SIZE)), (0, 0), sigmaX=24, sigmaY=0.6)
    streaks *= 8 / streaks.std()
    return _grained(
        np.array(color, np.float32) + streaks[..., None] + _smooth_noise(random, 128)[..., None] * 8, random
    )


def skin(random: np.random.Generator, color: Color) -> Texture:
    """Skin: blotches and fine creases of little contrast."""
    blotches = _smooth_noise(random, 40)[..., None] * np.array([6.0, 8.0, 7.0])
    creases = np.minimum(_smooth_noise(random, 5), 0)[..., None] * 8
    return _grained(np.array(color, np.float32) + blotches + creases, random, 2.0)


def _draw_shape(image: Texture, random: np.random.Generator, color: Color, largest: float = 0.16) -> None:
    middle = random.uniform(0.05, 0.95, 2) * SIZE
    reach = random.uniform(0.25, 1.0) * largest * SIZE
    kind = random.integers(4)
    x, y = (int(value) for value in middle)
    if kind == 0:
        cv2.circle(image, (x, y), int(reach * 0.7), color, -1 if random.random() < 0.6 else 7, cv2.LINE_AA)
    elif kind == 1:
        letter = "ABDEFGHKMNPRSTXZ2345679"[random.integers(23)]
        scale = reach / 22
        cv2.putText(image, letter, (x, y), cv2.FONT_HERSHEY_DUPLEX, scale, color, max(2, int(scale * 2)), cv2.LINE_AA)
    else:
        corners = 3 if kind == 2 else 4
        angles = random.uniform(0, 2 * np.pi) + np.arange(corners) * 2 * np.pi / corners
        stretch = random.uniform(0.4, 1.0, 2)
        outline = middle + reach * stretch * np.column_stack([np.cos(angles), np.sin(angles)])
        cv2.fillPoly(image, [outline.astype(np.int32)], color, cv2.LINE_AA)


def _smooth_noise(random: np.random.Generator, scale_px: float) -> Float[np.ndarray, "size size"]:
    """Noise of mean 0 and SD 1 whose blobs are about ``scale_px`` wide."""
    coarse = max(4, int(2 * SIZE / scale_px))
    noise = cv2.resize(random.normal(0, 1, (coarse, coarse)), (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
    return np.asarray((noise - noise.mean()) / noise.std())


def _grained(
    image: Texture | Float[np.ndarray, "size size 3"], random: np.random.Generator, strength: float = 2.0
) -> Texture:
    grain = random.normal(0, strength, image.shape[:2])[..., None] + _smooth_noise(random, 8)[..., None] * strength
    return np.clip(image + grain, 0, 255).astype(np.uint8)
