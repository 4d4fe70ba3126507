"""The Line Band Descriptor: 72 numbers that describe the surroundings of a segment.

L. Zhang and R. Koch, "An efficient and robust line segment matching approach based on LBD descriptor and pairwise
geometric consistency", Journal of Visual Communication and Image Representation 24 (2013), section 2.

Nine bands parallel to the segment are laid over it. Every row of a band is summarized by four sums of gradients, every
band by the mean and the standard deviation of its rows and of its neighbors' rows.

    row   -31 ..  -25   band 0        to the left of the line's direction (y is down)
           ...
    row    -3 ..    3   band 4        the segment itself is row 0
           ...
    row    25 ..   31   band 8        to its right
"""

import cv2
import numpy as np
from jaxtyping import Complex64, Float, Float32, Int, UInt8

BAND_COUNT = 9
DESCRIPTOR_DIM = 8 * BAND_COUNT
# The paper: no component above this, so that one strong edge (non-linear illumination) does not rule the rest.
COMPONENT_LIMIT = 0.4
# Differences of a picture that is not smoothed are ruled by the noise and blocks of its compression.
SMOOTHING_SIGMA_PX = 1.0
# The smoothing's rounding errors (about 3e-5 gray levels) must not pass for texture where the picture is uniform.
SMALLEST_GRADIENT = 1e-4
# One chunk holds about 80 bytes for each sample: some 20 MB at the peak, whatever the number of segments.
SAMPLES_PER_CHUNK = 1 << 18


def describe(
    image: UInt8[np.ndarray, "height width"], segments: Float[np.ndarray, "n 4"], band_width: int = 7
) -> Float32[np.ndarray, "n 72"]:
    """Describes segments ``[x1, y1, x2, y2]`` in pixels; each row has unit L2 norm.

    Component ``8 j + c`` is the mean, and ``8 j + 4 + c`` the standard deviation, of the sum ``v(c + 1)`` over the rows
    of band ``j`` and of its neighbors, ``j`` = 0 being the leftmost band. v1 and v2 add up the positive and the
    negative parts of the gradient across the line, to its right; v3 and v4 those along it.
    The means and the deviations are normalized apart, limited to 0.4, and normalized together.

    The order of the end points has no influence: the line is directed so that the mean gradient next to it (rows
    weighted by a Gaussian of 1 px) points to its right, that is, the brighter side is on its right hand. So a picture
    turned by any angle gives the same descriptor up to interpolation. Where that mean is zero the given order stands.

    Samples lie 1 px or a little less apart, between four pixels. Outside the picture the gradient is zero: what is
    unknown adds nothing. A segment whose whole surroundings are uniform has no descriptor; its row is all zeros.

    Args:
        image: gray.
        segments: in any order, partly or wholly outside the picture if need be.
        band_width: rows of 1 px in each band, odd. The region is ``9 * band_width`` px wide.

    Raises:
        ValueError: when the band width is not odd and positive, a coordinate is not finite, or a segment is shorter
            than a thousandth of a pixel.
    """
    if band_width < 1 or band_width % 2 == 0:
        raise ValueError(f"band_width is {band_width}; expected a positive odd number of pixels")
    lines = np.asarray(segments, np.float64).reshape(-1, 4)
    if not np.isfinite(lines).all():
        raise ValueError(f"segment {np.argmin(np.isfinite(lines).all(axis=1))} has a coordinate that is not finite")
    lengths = np.hypot(lines[:, 2] - lines[:, 0], lines[:, 3] - lines[:, 1])
    if np.any(lengths < 1e-3):
        row = int(np.argmin(lengths))
        raise ValueError(f"segment {row} is {lines[row].tolist()}, of length {lengths[row]:g} px; expected two points")
    if len(lines) == 0:
        return np.zeros((0, DESCRIPTOR_DIM), np.float32)

    gradient = _gradient(image)
    counts = np.ceil(lengths).astype(np.int64)
    chunk_of_line = np.cumsum(counts) * BAND_COUNT * band_width // SAMPLES_PER_CHUNK
    chunks = np.split(np.arange(len(lines)), np.flatnonzero(np.diff(chunk_of_line)) + 1)
    row_sums = np.concatenate([_row_sums(gradient, lines[c], lengths[c], counts[c], band_width) for c in chunks])
    return _normalize(*_band_statistics(_directed(row_sums), band_width))


def _gradient(image: UInt8[np.ndarray, "height width"]) -> Complex64[np.ndarray, "padded_height padded_width"]:
    """``dx + i dy`` by central differences, with a ring of zeros around the picture for whatever lies outside."""
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING_SIGMA_PX, borderType=cv2.BORDER_REPLICATE)
    padded = cv2.copyMakeBorder(smooth, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    gradient = np.zeros(padded.shape, np.complex64)
    across = 0.5 * (padded[1:-1, 2:] - padded[1:-1, :-2])
    down = 0.5 * (padded[2:, 1:-1] - padded[:-2, 1:-1])
    gradient.real[1:-1, 1:-1] = np.where(np.abs(across) < SMALLEST_GRADIENT, 0, across)
    gradient.imag[1:-1, 1:-1] = np.where(np.abs(down) < SMALLEST_GRADIENT, 0, down)
    return gradient


def _row_sums(
    gradient: Complex64[np.ndarray, "padded_height padded_width"],
    lines: Float[np.ndarray, "n 4"],
    lengths: Float[np.ndarray, " n"],
    counts: Int[np.ndarray, " n"],
    band_width: int,
) -> Float[np.ndarray, "n rows 4"]:
    """v1 to v4 of every row of every segment, in the given direction; the samples of all segments lie side by side."""
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    line_of_column = np.repeat(np.arange(len(lines)), counts)
    fraction = (np.arange(len(line_of_column)) - firsts[line_of_column] + 0.5) / counts[line_of_column]
    start = lines[:, 0] + 1j * lines[:, 1]
    along = (lines[:, 2] - lines[:, 0]) + 1j * (lines[:, 3] - lines[:, 1])
    direction = along / lengths
    # With y down, a quarter turn from x toward y, a factor of i, leads to the right hand.
    offsets = np.arange(BAND_COUNT * band_width) - (BAND_COUNT * band_width - 1) / 2
    column = start[line_of_column] + fraction * along[line_of_column]
    places = (column + offsets[:, None] * (1j * direction)[line_of_column]).astype(np.complex64)
    # Dividing by the direction turns a gradient into (along the line) + i (to its right).
    local = _sample(gradient, places) * np.conj(direction).astype(np.complex64)[line_of_column]
    parts = [local.imag, -local.imag, local.real, -local.real]
    sums = np.empty((len(lines), len(offsets), len(parts)), np.float32)
    for index, part in enumerate(parts):
        sums[..., index] = np.add.reduceat(np.maximum(part, 0), firsts, axis=1).T
    return sums


def _sample(
    gradient: Complex64[np.ndarray, "padded_height padded_width"], places: Complex64[np.ndarray, "rows columns"]
) -> Complex64[np.ndarray, "rows columns"]:
    """Bilinear interpolation at ``x + i y`` of the picture; beyond the ring of zeros it is zero."""
    height, width = gradient.shape
    x = np.clip(places.real + 1, 0, width - 1)
    y = np.clip(places.imag + 1, 0, height - 1)
    left = np.minimum(x.astype(np.int32), width - 2)
    top = np.minimum(y.astype(np.int32), height - 2)
    x -= left
    y -= top
    flat, corner = gradient.ravel(), top * width + left
    upper: Complex64[np.ndarray, "rows columns"] = flat[corner]
    lower: Complex64[np.ndarray, "rows columns"] = flat[corner + width]
    upper += x * (flat[corner + 1] - upper)
    lower += x * (flat[corner + (width + 1)] - lower)
    lower -= upper
    lower *= y
    lower += upper
    return lower


def _directed(row_sums: Float[np.ndarray, "n rows 4"]) -> Float[np.ndarray, "n rows 4"]:
    """Turns each segment by 180 degrees, where needed, so that the gradient next to it points to its right."""
    from_line = np.arange(row_sums.shape[1]) - (row_sums.shape[1] - 1) / 2
    rightwards = (row_sums[..., 0] - row_sums[..., 1]).astype(np.float64) @ np.exp(-0.5 * from_line**2)
    turned = row_sums[:, ::-1][..., [1, 0, 3, 2]]
    return np.where((rightwards < 0)[:, None, None], turned, row_sums)


def _band_statistics(
    row_sums: Float[np.ndarray, "n rows 4"], band_width: int
) -> tuple[Float[np.ndarray, "n bands 4"], Float[np.ndarray, "n bands 4"]]:
    """Mean and standard deviation over the weighted rows of each band and its neighbors."""
    row_count = BAND_COUNT * band_width
    row = np.arange(row_count)
    band = np.arange(BAND_COUNT)[:, None]
    from_line = row - (row_count - 1) / 2
    from_band = row - (band * band_width + (band_width - 1) / 2)
    global_weight = np.exp(-0.5 * (from_line / (0.5 * (row_count - 1))) ** 2)
    local_weight = np.exp(-0.5 * (from_band / band_width) ** 2)
    member = np.abs(row // band_width - band) <= 1
    weight = np.where(member, global_weight * local_weight, 0)
    member_count = member.sum(axis=1, keepdims=True)
    sums = row_sums.astype(np.float64)
    mean = (weight / member_count) @ sums
    mean_square = (weight**2 / member_count) @ sums**2
    return mean, np.sqrt(np.maximum(mean_square - mean**2, 0))


def _normalize(
    mean: Float[np.ndarray, "n bands 4"], deviation: Float[np.ndarray, "n bands 4"]
) -> Float32[np.ndarray, "n 72"]:
    """The two parts, each of unit norm, interleaved band by band, limited, and of unit norm together."""
    parts = [part / np.maximum(np.linalg.norm(part, axis=(1, 2), keepdims=True), 1e-9) for part in (mean, deviation)]
    limited = np.minimum(np.concatenate(parts, axis=2).reshape(len(mean), DESCRIPTOR_DIM), COMPONENT_LIMIT)
    norm = np.linalg.norm(limited, axis=1, keepdims=True)
    descriptors: Float32[np.ndarray, "n 72"] = (limited / np.maximum(norm, 1e-9)).astype(np.float32)
    return descriptors
