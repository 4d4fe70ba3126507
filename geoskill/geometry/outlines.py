"""Outlines of planes in the picture: boxes of four corners, in order round about."""

import numpy as np
from jaxtyping import Float, Float32


def distance_to_outline(
    points: Float[np.ndarray, "p 2"], outlines: Float[np.ndarray, "n 8"]
) -> Float32[np.ndarray, "p n"]:
    """Return how far points are outside of outlines, across the farthest side in pixels; 0 within.

    >>> box = np.array([[0.0, 0.0, 4.0, 0.0, 4.0, 2.0, 0.0, 2.0]])
    >>> distance_to_outline(np.array([[1.0, 1.0], [7.0, 1.0], [-2.0, 3.0]]), box).tolist()
    [[0.0], [3.0], [2.0]]
    """
    corners = outlines.reshape(-1, 4, 2)
    sides = np.roll(corners, -1, axis=1) - corners
    outward = np.stack([sides[..., 1], -sides[..., 0]], axis=2)
    outward = outward / np.maximum(np.linalg.norm(outward, axis=2, keepdims=True), 1e-9)
    # Turned round where the corners are listed the other way about.
    inward = ((corners.mean(axis=1, keepdims=True) - corners) * outward).sum(axis=2).sum(axis=1) > 0
    outward = np.where(inward[:, None, None], -outward, outward)
    across = ((points[:, None, None] - corners) * outward).sum(axis=3).max(axis=2)
    return np.asarray(np.maximum(across, 0.0), np.float32)
