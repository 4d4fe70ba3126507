"""Display matrices by hand, and written into a file."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from geoskill.io.orientation import oriented
from geoskill.io.video import VideoFile
from tests.io.test_video import write_video

ONE = 1 << 16


@pytest.mark.parametrize(
    "matrix",
    [
        *((a, 0, 0, d) for a, d in itertools.product((1, -1), repeat=2)),
        *((0, b, c, 0) for b, c in itertools.product((1, -1), repeat=2)),
    ],
    ids=str,
)
def test_every_pixel_goes_where_the_matrix_says(matrix: tuple[int, int, int, int]) -> None:
    picture = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    a, b, c, d = matrix
    out = oriented(picture, np.array([[a, b, 0], [c, d, 0], [0, 0, 1]]) * ONE)
    rows, columns = np.indices((2, 3))
    x, y = a * columns + c * rows, b * columns + d * rows  # ISO/IEC 14496-12, 8.3.2
    np.testing.assert_array_equal(out[y - y.min(), x - x.min()], picture)
    assert out.flags.c_contiguous


@pytest.mark.parametrize("degrees", [-170, -100, -60, -10, 10, 40, 95, 175])
def test_other_angles_are_rounded_to_quarter_turns(degrees: int) -> None:
    picture = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))  # clockwise, as y is down
    matrix = (np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) * ONE).astype(np.int32)
    np.testing.assert_array_equal(oriented(picture, matrix), np.rot90(picture, -round(degrees / 90)))


def test_matrix_of_zeros_changes_nothing() -> None:
    picture = np.arange(2 * 3 * 3, dtype=np.uint8).reshape(2, 3, 3)
    np.testing.assert_array_equal(oriented(picture, np.zeros((3, 3), np.int32)), picture)


@pytest.mark.parametrize(
    ("matrix", "corner"),
    [((-1, 0, 0, 1), (0, -1)), ((1, 0, 0, -1), (-1, 0)), ((0, 1, 1, 0), (0, 0)), ((0, -1, -1, 0), (-1, -1))],
    ids=["mirrored", "flipped", "transposed", "transversed"],
)
def test_mirrored_file_is_shown_as_players_do(
    tmp_path: Path, matrix: tuple[int, int, int, int], corner: tuple[int, int]
) -> None:
    picture = np.full((48, 64, 3), 30, np.uint8)
    picture[:16, :16] = 220  # the top left corner
    path = write_video(tmp_path / "selfie.mp4", [picture] * 2)
    data = bytearray(path.read_bytes())
    start = data.index(b"tkhd") + 44
    a, b, c, d = (entry * ONE for entry in matrix)
    data[start : start + 36] = np.array([a, b, 0, c, d, 0, 0, 0, 1 << 30], ">i4").tobytes()
    path.write_bytes(data)
    image = next(iter(VideoFile(path))).image
    assert image.shape == ((48, 64, 3) if matrix[0] else (64, 48, 3))
    bright = [(row, column) for row, column in itertools.product((0, -1), repeat=2) if image[row, column, 0] > 125]
    assert bright == [corner]
