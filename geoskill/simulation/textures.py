"""Random textures of surfaces: prints, wood, felt, stone, cloth, metal and skin.

All are square RGB images, :data:`SIZE` pixels wide, with grain of several scales, since no real surface has one uniform
color.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Texture = UInt8[np.ndarray, "height width 3"]
Color = Sequence[float]  # red, green, blue

SIZE = 512


def print_on_card(rng: np.random.Generator, paper: Color, shapes: int = 26, contrast: float = 1.0) -> Texture:
    """Draw a printed card: dark and colored shapes and letters on light paper, rich in corners.

    Args:
        rng: draws the texture.
        paper: color of the paper, RGB from 0 to 255.
        shapes: number of shapes and letters.
        contrast: of the shapes against the paper, from 0 to 1.
    """
    image = np.full((SIZE, SIZE, 3), paper, np.uint8)
    for _ in range(shapes):
        color = np.array(paper) * (1 - contrast) + contrast * rng.uniform(0, 200, 3) * rng.choice([0.25, 1.0])
        _draw_shape(image, rng, tuple(map(float, color)))
    cv2.rectangle(image, (6, 6), (SIZE - 7, SIZE - 7), (40.0, 40.0, 50.0), 8, cv2.LINE_AA)
    return _grained(image, rng, 3.0)


def cut_card(card: Texture, size: tuple[float, float]) -> UInt8[np.ndarray, "cut_height cut_width 3"]:
    """Return a part of a card, without its border, with the aspect ratio of a surface of that size (width, height)."""
    inner = card[16:-16, 16:-16]
    aspect = size[1] / size[0]
    return inner[: round(len(inner) * min(1.0, aspect)), : round(len(inner) * min(1.0, 1 / aspect))]


def wood(rng: np.random.Generator, color: Color, contrast: float = 12.0) -> Texture:
    """Draw wood with a soft grain along x."""
    rows = np.cumsum(rng.normal(0, 1, SIZE))
    rows = (rows - cv2.GaussianBlur(rows[:, None], (1, 101), 30)[:, 0]) / 4
    wave = _smooth_noise(rng, 128) * 20
    indices = np.clip(np.arange(SIZE)[:, None] + wave, 0, SIZE - 1).astype(int)
    shade = np.clip(rows[indices], -2, 2) * contrast / 2 + _smooth_noise(rng, 64) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], rng, 2.0)


def felt(rng: np.random.Generator, color: Color, contrast: float = 6.0) -> Texture:
    """Draw felt, a plain cloth of short fibers, with large soft stains."""
    shade = _smooth_noise(rng, 96) * contrast + _smooth_noise(rng, 4) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], rng, 4.0)


def stone(rng: np.random.Generator, color: Color, contrast: float = 14.0) -> Texture:
    """Draw a speckled stone worktop."""
    shade = _smooth_noise(rng, 3) * contrast + _smooth_noise(rng, 24) * contrast / 2
    return _grained(np.array(color, np.float32) + shade[..., None], rng, 3.0)


def printed_cloth(rng: np.random.Generator, ground: Color) -> Texture:
    """Draw a tea towel: a woven ground with stripes and scattered small prints."""
    image = np.full((SIZE, SIZE, 3), ground, np.uint8)
    stripe = (np.array(ground) + rng.uniform(30, 150, 3)) / 2
    for position in (0.06, 0.12, 0.88, 0.94):
        start = int(position * SIZE)
        image[:, start : start + 10] = stripe.astype(np.uint8)
    for _ in range(46):
        color = rng.uniform(20, 170, 3)
        _draw_shape(image, rng, tuple(map(float, color)), largest=0.07)
    weave = 5 * np.sin(np.arange(SIZE) * np.pi / 2)
    return _grained(image + weave[:, None, None] + weave[None, :, None], rng, 3.0)


def striped_print(
    rng: np.random.Generator, paper: Color, along: Sequence[float], across: Sequence[float], shapes: int = 130
) -> Texture:
    """Draw a printed sheet of small shapes, and over them straight stripes from edge to edge.

    Args:
        rng: draws the texture.
        paper: color of the paper, RGB from 0 to 255.
        along: positions of the vertical stripes, as shares of the width from the left.
        across: positions of the horizontal stripes, as shares of the height from the top.
        shapes: number of shapes and letters.
    """
    image = np.full((SIZE, SIZE, 3), paper, np.uint8)
    for _ in range(shapes):
        color = rng.uniform(0, 200, 3) * rng.choice([0.25, 1.0])
        _draw_shape(image, rng, tuple(map(float, color)), largest=0.05)
    half = SIZE // 70
    # A margin beside the stripes is blank, so that their edges are visible as lines.
    for width, ink in ((2 * half, np.array(paper)), (half, rng.uniform(10, 110, 3))):
        for center in along:
            image[:, round(center * SIZE) - width : round(center * SIZE) + width] = ink
        for center in across:
            image[round(center * SIZE) - width : round(center * SIZE) + width] = ink
    return _grained(image, rng, 3.0)


def metal(rng: np.random.Generator, color: Color) -> Texture:
    """Draw brushed sheet metal, with fine streaks along x."""
    streaks = cv2.GaussianBlur(rng.normal(0, 1, (SIZE, SIZE)), (0, 0), sigmaX=24, sigmaY=0.6)
    streaks *= 8 / streaks.std()
    return _grained(np.array(color, np.float32) + streaks[..., None] + _smooth_noise(rng, 128)[..., None] * 8, rng)


def skin(rng: np.random.Generator, color: Color) -> Texture:
    """Draw skin, with blotches and fine creases of low contrast."""
    blotches = _smooth_noise(rng, 40)[..., None] * np.array([6.0, 8.0, 7.0])
    creases = np.minimum(_smooth_noise(rng, 5), 0)[..., None] * 8
    return _grained(np.array(color, np.float32) + blotches + creases, rng, 2.0)


def _draw_shape(image: Texture, rng: np.random.Generator, color: Color, largest: float = 0.16) -> None:
    """Draw a random disk, ring, letter, triangle or quadrangle whose radius is at most ``largest`` of the image."""
    center = rng.uniform(0.05, 0.95, 2) * SIZE
    radius = rng.uniform(0.25, 1.0) * largest * SIZE
    shape = rng.integers(4)
    x, y = (int(value) for value in center)
    if shape == 0:
        cv2.circle(image, (x, y), int(radius * 0.7), color, -1 if rng.random() < 0.6 else 7, cv2.LINE_AA)
    elif shape == 1:
        letter = "ABDEFGHKMNPRSTXZ2345679"[rng.integers(23)]
        scale = radius / 22
        cv2.putText(image, letter, (x, y), cv2.FONT_HERSHEY_DUPLEX, scale, color, max(2, int(scale * 2)), cv2.LINE_AA)
    else:
        corners = 3 if shape == 2 else 4
        angles = rng.uniform(0, 2 * np.pi) + np.arange(corners) * 2 * np.pi / corners
        stretch = rng.uniform(0.4, 1.0, 2)
        outline = center + radius * stretch * np.column_stack([np.cos(angles), np.sin(angles)])
        cv2.fillPoly(image, [outline.astype(np.int32)], color, cv2.LINE_AA)


def _smooth_noise(rng: np.random.Generator, scale_px: float) -> Float[np.ndarray, "size size"]:
    """Return noise of mean 0 and standard deviation 1 with blobs that are about ``scale_px`` wide."""
    coarse = max(4, int(2 * SIZE / scale_px))
    noise = cv2.resize(rng.normal(0, 1, (coarse, coarse)), (SIZE, SIZE), interpolation=cv2.INTER_CUBIC)
    return np.asarray((noise - noise.mean()) / noise.std())


def _grained(
    image: Texture | Float[np.ndarray, "size size 3"], rng: np.random.Generator, strength: float = 2.0
) -> Texture:
    grain = rng.normal(0, strength, image.shape[:2])[..., None] + _smooth_noise(rng, 8)[..., None] * strength
    return np.clip(image + grain, 0, 255).astype(np.uint8)
