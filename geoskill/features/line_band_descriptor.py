"""The Line Band Descriptor: 72 numbers that describe the neighborhood of a segment.

L. Zhang and R. Koch, "An efficient and robust line segment matching approach based on LBD descriptor and pairwise
geometric consistency", Journal of Visual Communication and Image Representation 24 (2013), section 2.

Nine bands parallel to the segment cover its neighborhood. Every row of a band is summarized by four sums of gradients,
and every band by the mean and standard deviation over its own rows and those of the adjacent bands::

    row   -31 ..  -25   band 0        left of the line's direction (y is down)
           ...
    row    -3 ..    3   band 4        the segment itself is row 0
           ...
    row    25 ..   31   band 8        right of it
"""

import cv2
import numpy as np
from jaxtyping import Complex64, Float, Float32, Int, UInt8

BAND_COUNT = 9
DESCRIPTOR_DIM = 8 * BAND_COUNT
# Largest component, as in the paper, so that one strong edge (non-linear illumination) does not dominate.
COMPONENT_LIMIT = 0.4
# Without smoothing, gradients are dominated by noise and compression artifacts.
SMOOTHING_SIGMA_PX = 1.0
# Rounding errors of the smoothing (about 3e-5 gray levels) must not count as texture in a uniform picture.
SMALLEST_GRADIENT = 1e-4
# A sample takes about 80 bytes, so a chunk takes some 20 MB, whatever the number of segments.
SAMPLES_PER_CHUNK = 1 << 18


def describe(
    image: UInt8[np.ndarray, "height width"], segments: Float[np.ndarray, "n 4"], band_width: int = 7
) -> Float32[np.ndarray, "n 72"]:
    """Return the descriptors of segments ``[x1, y1, x2, y2]`` in pixels; each row has unit L2 norm.

    Component ``8 j + c`` is the mean, and ``8 j + 4 + c`` the standard deviation, of the sum ``v(c + 1)`` over the rows
    of band ``j`` and of the adjacent bands, band 0 being the leftmost. v1 and v2 are the sums of the positive and
    negative parts of the gradient across the line (positive to the right); v3 and v4 are those along the line.
    Means and deviations are normalized separately, limited to 0.4, and normalized together.

    The order of the end points has no influence: the line is directed so that the mean gradient next to it (rows
    weighted by a Gaussian of 1 px) points to its right, so the brighter side is on the right. Rotating the picture
    therefore leaves the descriptor unchanged up to interpolation. If that mean is zero, the given order is kept.

    Samples are at most 1 px apart and interpolated bilinearly. Outside the picture the gradient is zero. A segment with
    a uniform neighborhood has no descriptor; its row is all zeros.

    Args:
        image: gray.
        segments: may lie partly or wholly outside the picture.
        band_width: number of rows (1 px each) per band, odd. The region is ``9 * band_width`` px wide.

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
    """Return ``dx + i dy`` by central differences, with a border of zeros that stands for the outside."""
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
    """Return v1 to v4 of every row of every segment, in the given direction.

    The samples of all segments are the columns of one array, one segment after the other.
    """
    firsts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    line_of_column = np.repeat(np.arange(len(lines)), counts)
    fraction = (np.arange(len(line_of_column)) - firsts[line_of_column] + 0.5) / counts[line_of_column]
    start = lines[:, 0] + 1j * lines[:, 1]
    along = (lines[:, 2] - lines[:, 0]) + 1j * (lines[:, 3] - lines[:, 1])
    direction = along / lengths
    # y points down, so a quarter turn from x toward y, a factor of i, leads to the right.
    offsets = np.arange(BAND_COUNT * band_width) - (BAND_COUNT * band_width - 1) / 2
    column = start[line_of_column] + fraction * along[line_of_column]
    positions = (column + offsets[:, None] * (1j * direction)[line_of_column]).astype(np.complex64)
    # Dividing by the direction turns a gradient into (along the line) + i (to its right).
    local = _sample(gradient, positions) * np.conj(direction).astype(np.complex64)[line_of_column]
    components = [local.imag, -local.imag, local.real, -local.real]
    sums = np.empty((len(lines), len(offsets), len(components)), np.float32)
    for index, component in enumerate(components):
        sums[..., index] = np.add.reduceat(np.maximum(component, 0), firsts, axis=1).T
    return sums


def _sample(
    gradient: Complex64[np.ndarray, "padded_height padded_width"], positions: Complex64[np.ndarray, "rows columns"]
) -> Complex64[np.ndarray, "rows columns"]:
    """Return the gradient at ``x + i y`` of the picture, interpolated bilinearly; zero outside the border.

    Not ``scipy.ndimage.map_coordinates``, which takes three times as long and rounds differently
    (docs/experiments/features.md); nor ``cv2.remap``, which interpolates two channels in steps of 1/32 pixel.
    """
    height, width = gradient.shape
    x = np.clip(positions.real + 1, 0, width - 1)
    y = np.clip(positions.imag + 1, 0, height - 1)
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
    """Turn segments by 180 degrees where the mean gradient next to them does not point to their right."""
    from_line = np.arange(row_sums.shape[1]) - (row_sums.shape[1] - 1) / 2
    rightwards = (row_sums[..., 0] - row_sums[..., 1]).astype(np.float64) @ np.exp(-0.5 * from_line**2)
    reversed_sums = row_sums[:, ::-1][..., [1, 0, 3, 2]]
    return np.where((rightwards < 0)[:, None, None], reversed_sums, row_sums)


def _band_statistics(
    row_sums: Float[np.ndarray, "n rows 4"], band_width: int
) -> tuple[Float[np.ndarray, "n bands 4"], Float[np.ndarray, "n bands 4"]]:
    """Return mean and standard deviation over the weighted rows of each band and the adjacent bands."""
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
    """Normalize means and deviations separately, interleave them by band, limit them, and normalize them together."""
    halves = [half / np.maximum(np.linalg.norm(half, axis=(1, 2), keepdims=True), 1e-9) for half in (mean, deviation)]
    limited = np.minimum(np.concatenate(halves, axis=2).reshape(len(mean), DESCRIPTOR_DIM), COMPONENT_LIMIT)
    norm = np.linalg.norm(limited, axis=1, keepdims=True)
    descriptors: Float32[np.ndarray, "n 72"] = (limited / np.maximum(norm, 1e-9)).astype(np.float32)
    return descriptors
