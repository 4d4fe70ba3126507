"""Transforms of image coordinates.

The center of the top left pixel is (0, 0): that pixel covers -0.5 to 0.5.
"""

import numpy as np
from jaxtyping import Float


def rescale_points(
    coordinates: Float[np.ndarray, "n coordinates"], factor_x: float, factor_y: float
) -> Float[np.ndarray, "n coordinates"]:
    """Convert points ``[n, 2]``, segments ``[n, 4]`` and the like of a picture to pixels of its resized version.

    A resize keeps pixel edges, not pixel centers, in place, as ``cv2.resize`` does: x' = (x + 0.5) · factor - 0.5.
    The inverse is the same function with the inverse factors.

    Args:
        coordinates: x and y in turn.
        factor_x: width of the resized picture divided by the original width.
        factor_y: height of the resized picture divided by the original height.

    Raises:
        ValueError: when a factor is not positive and finite, or a row has no even number of coordinates.

    The middle of a row of 4 pixels stays in the middle when the picture is doubled (1.5 → 3.5):

    >>> rescale_points(np.array([[1.5, 0.0]]), 2.0, 2.0)
    array([[3.5, 0.5]])
    """
    if not (0 < factor_x < np.inf and 0 < factor_y < np.inf):
        raise ValueError(f"scale factors are {factor_x} and {factor_y}; expected positive finite numbers")
    if coordinates.ndim != 2 or coordinates.shape[1] % 2 or coordinates.shape[1] == 0:
        raise ValueError(f"coordinates have shape {coordinates.shape}; expected x and y in turn, [n, 2], [n, 4], …")
    factors = np.tile(np.array([factor_x, factor_y], coordinates.dtype), coordinates.shape[1] // 2)
    half = coordinates.dtype.type(0.5)
    rescaled: Float[np.ndarray, "n coordinates"] = (coordinates + half) * factors - half
    return rescaled
