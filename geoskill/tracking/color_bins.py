"""Colors as bins of Lab, and their histograms: what a thing looks like, however it is turned."""

import numpy as np
from jaxtyping import Float32, Float64, UInt16
from scipy.ndimage import gaussian_filter

# Bins of about 8 units of Lab along each axis, and the ranges that they divide.
BINS = (12, 32, 32)
RANGES = ((0.0, 100.0), (-128.0, 128.0), (-128.0, 128.0))
# Standard deviation in bins: a color that falls just beyond a bin is still the same.
SMOOTHING = 0.8


def color_bins(picture: Float32[np.ndarray, "*shape 3"]) -> UInt16[np.ndarray, "*shape"]:
    """Return for each Lab pixel the number of its bin, below the product of :data:`BINS`."""
    low, high = np.array(RANGES, np.float32).T
    index = ((picture - low) / (high - low) * np.array(BINS, np.float32)).astype(np.int64)
    return np.asarray(np.ravel_multi_index(tuple(np.moveaxis(index, -1, 0)), BINS, mode="clip"), np.uint16)


def color_histogram(bins: UInt16[np.ndarray, " n"]) -> Float64[np.ndarray, " b"]:
    """Return the smoothed share of each bin among some pixels; uniform where there is none."""
    counts = np.bincount(bins, minlength=int(np.prod(BINS))).astype(np.float64)
    if not counts.any():
        return np.full(counts.shape, 1.0 / counts.size)
    smooth = gaussian_filter(counts.reshape(BINS), SMOOTHING).ravel()
    return np.asarray(smooth / smooth.sum())
