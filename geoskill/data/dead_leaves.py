"""Dead leaves: random pictures of leaves that lie over each other, with edges and corners of no particular object.

The dead leaves model has the statistics of natural pictures over all scales ("Origins of scaling in natural images",
Ruderman, 1997), and features learn from it as from photographs ("Learning to see by looking at noise", Baradad et al.,
NeurIPS 2021).
"""

import cv2
import numpy as np
from jaxtyping import UInt8

# Range of radii, over the picture's shorter side. Their density falls with the cube of the radius, which makes the
# picture's statistics independent of scale.
MIN_RADIUS, MAX_RADIUS = 0.0125, 0.3
LEAVES = 700
# Of the camera: SD of the blur in pixels, and of the noise in gray levels.
BLUR_PX, NOISE = 1.0, 3.0


def dead_leaves(height: int, width: int, random: np.random.Generator) -> UInt8[np.ndarray, "height width 3"]:
    """Draw discs and polygons of three to five corners in single colors, with the blur and noise of a camera."""
    side = min(height, width)
    picture = np.full((height, width, 3), 128, np.float32)
    # Inverse transform sampling of a density r^-3 between the two radii.
    quantiles = random.random(LEAVES)
    radii = (MIN_RADIUS**-2 - quantiles * (MIN_RADIUS**-2 - MAX_RADIUS**-2)) ** -0.5 * side
    for radius in radii:
        center = random.uniform((0, 0), (width, height))
        # From gray to vivid, so that no degree of saturation tells leaves from objects.
        gray, vivid = random.uniform(0, 255), random.uniform(0, 255, 3)
        color = (gray + random.random() ** 2 * (vivid - gray)).tolist()
        corners = int(random.integers(2, 6))
        if corners == 2:  # stands for a disc
            cv2.circle(picture, center.astype(int).tolist(), round(float(radius)), color, cv2.FILLED)
        else:
            angles = np.sort(random.uniform(0, 2 * np.pi, corners))
            outline = center + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            cv2.fillPoly(picture, [outline.round().astype(np.int32)], color)
    captured = cv2.GaussianBlur(picture, (0, 0), BLUR_PX) + random.normal(0, NOISE, picture.shape)
    return np.clip(captured, 0, 255).astype(np.uint8)
