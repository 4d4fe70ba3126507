"""The colors around a feature, to stand beside a descriptor that only knows gray.

Descriptors of gradients cannot tell a printed disk from a screw, or one printed card from the next of another color;
people tell them by their color, and name them by it. Color descriptors that are put beside those of gradients are an
old idea ("Evaluating color descriptors for object and scene recognition", van de Sande et al., PAMI 2010); these are
few, since a demonstration is one.

A place is described by two opponent colors over the light there, which shade and exposure leave as they are::

    red against green    (R - G) / (sqrt(2) L)
    yellow against blue  (R + G - 2 B) / (sqrt(6) L)        L = R + G + B + floor

Five places: the middle of the feature, and four around it in the feature's own directions, so that the colors turn and
grow with it.
"""

import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.features.pyramid import sample_at

PLACES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], np.float32)
COLOR_DIM = 2 * len(PLACES)
# The places around lie half as far out as the descriptor looks; each is a mean over about a third of that.
PLACE_SHARE, MEAN_SHARE = 1 / 2, 1 / 6
# Of the picture's mean light, added to that of a place: in the dark the noise of the sensor would pass for color.
FLOOR_SHARE = 0.15


def colors_around(
    picture: UInt8[np.ndarray, "height width 3"], middles: Float32[np.ndarray, "n 2"], arms: Float32[np.ndarray, "n 2"]
) -> Float32[np.ndarray, "n 10"]:
    """The opponent colors of the five places of every feature, each in about [-1, 1] and 0 for gray.

    Args:
        picture: RGB.
        middles: of the features, in pixels.
        arms: from there to the edge of what the descriptor describes, in the direction that it takes for its own.
    """
    across = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    around = PLACES[:, :1, None] * arms.T + PLACES[:, 1:, None] * across.T
    places = middles[:, None] + PLACE_SHARE * around.transpose(2, 0, 1)
    size_px = np.maximum(MEAN_SHARE * np.linalg.norm(arms, axis=1), 1.0).astype(np.float32)
    return sample_at(_opponent(picture), places.astype(np.float32), size_px).reshape(len(middles), COLOR_DIM)


def _opponent(picture: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "height width 2"]:
    red, green, blue = np.moveaxis(picture.astype(np.float32), 2, 0)
    light = red + green + blue
    light = light + np.float32(max(FLOOR_SHARE * float(light.mean()), 1.0))
    first, second = (red - green) / (np.sqrt(2) * light), (red + green - 2 * blue) / (np.sqrt(6) * light)
    return np.stack([first, second], axis=2).astype(np.float32)
