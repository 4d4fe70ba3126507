"""Opponent colors around a feature, which supplement a descriptor of gray values.

Descriptors of gradients cannot tell a printed disk from a screw, or one printed card from another of a different color;
people tell them apart, and name them, by color. Combining color with gradient descriptors is an old idea ("Evaluating
color descriptors for object and scene recognition", van de Sande et al., PAMI 2010). Here the color descriptor is
short, because one demonstration gives little data.

Each sample has two opponent colors divided by the brightness, which makes them invariant to shade and exposure::

    red-green    (R - G) / (sqrt(2) L)
    yellow-blue  (R + G - 2 B) / (sqrt(6) L)        L = R + G + B + floor

There are five samples: the center of the feature, and four around it in its local affine frame, so that they rotate
and scale with the feature.
"""

import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.features.pyramid import sample_at

# Coordinates of the samples in the feature's frame, in units of SAMPLE_RADIUS.
SAMPLES = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], np.float32)
COLOR_DIM = 2 * len(SAMPLES)
# Distance of the outer samples from the center, and width of the average around a sample, in support radii.
SAMPLE_RADIUS, AVERAGE_WIDTH = 1 / 2, 1 / 6
# The floor as a fraction of the picture's mean brightness: in the dark, sensor noise would pass for color.
FLOOR_RATIO = 0.15


def colors_around(
    picture: UInt8[np.ndarray, "height width 3"],
    positions: Float32[np.ndarray, "n 2"],
    orientation_px: Float32[np.ndarray, "n 2"],
) -> Float32[np.ndarray, "n 10"]:
    """Return the opponent colors of the five samples of every feature, each in about [-1, 1] and 0 for gray.

    Args:
        picture: RGB.
        positions: centers of the features, in pixels.
        orientation_px: vectors from the center to the edge of the described region, along the feature's x axis (see
            :class:`~geoskill.features.feature_set.FeatureSet`).
    """
    x_axis, y_axis = orientation_px, np.stack([-orientation_px[:, 1], orientation_px[:, 0]], axis=1)
    offsets = SAMPLES[:, :1, None] * x_axis.T + SAMPLES[:, 1:, None] * y_axis.T
    samples = positions[:, None] + SAMPLE_RADIUS * offsets.transpose(2, 0, 1)
    size_px = np.maximum(AVERAGE_WIDTH * np.linalg.norm(orientation_px, axis=1), 1.0).astype(np.float32)
    return sample_at(_opponent_colors(picture), samples.astype(np.float32), size_px).reshape(len(positions), COLOR_DIM)


def _opponent_colors(picture: UInt8[np.ndarray, "height width 3"]) -> Float32[np.ndarray, "height width 2"]:
    red, green, blue = np.moveaxis(picture.astype(np.float32), 2, 0)
    brightness = red + green + blue
    brightness = brightness + np.float32(max(FLOOR_RATIO * float(brightness.mean()), 1.0))
    red_green = (red - green) / (np.sqrt(2) * brightness)
    yellow_blue = (red + green - 2 * blue) / (np.sqrt(6) * brightness)
    return np.stack([red_green, yellow_blue], axis=2).astype(np.float32)
