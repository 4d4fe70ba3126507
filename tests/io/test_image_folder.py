"""Folders of pictures written here: their order, what is left out, and the messages for bad input."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.image_folder import ImageFolder

HEIGHT, WIDTH = 48, 64


def plain(level: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Return a picture, red on the left and gray on the right: shows swapped channels, mirroring and frame order."""
    image = np.full((height, width, 3), level, np.uint8)
    image[:, : width // 2] = (200, 20, 20)
    return image


def write_image(path: Path, image: np.ndarray) -> None:
    assert cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def noise(count: int) -> list[np.ndarray]:
    """Return frames that do not compress, so that each takes up a large share of the file."""
    random = np.random.default_rng(0)
    return [random.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(count)]


def test_frames_come_in_natural_order_with_exact_pixels_and_times(tmp_path: Path) -> None:
    for number in (10, 2, 1):
        write_image(tmp_path / f"frame{number}.png", plain(number))
    (tmp_path / "notes.txt").write_text("no picture")
    (tmp_path / ".frame3.png").write_text("some systems leave such a file beside a picture")
    frames = list(ImageFolder(tmp_path, frame_rate=4.0))
    assert [int(frame.image[0, -1, 0]) for frame in frames] == [1, 2, 10]
    assert [frame.index for frame in frames] == [0, 1, 2]
    assert [frame.time_s for frame in frames] == [0.0, 0.25, 0.5]
    np.testing.assert_array_equal(frames[2].image, plain(10))


def test_can_be_read_repeatedly_and_lazily(tmp_path: Path) -> None:
    write_image(tmp_path / "1.png", plain(1))
    (tmp_path / "2.png").write_bytes(b"broken")
    folder = ImageFolder(tmp_path)
    for _ in range(2):
        np.testing.assert_array_equal(next(iter(folder)).image, plain(1))
    assert folder.frame_rate == 30.0
    assert folder.name == str(tmp_path)


@pytest.mark.parametrize("suffix", [".jpg", ".jpeg", ".PNG", ".bmp", ".webp", ".tif"])
def test_every_type_is_read_in_rgb(tmp_path: Path, suffix: str) -> None:
    write_image(tmp_path / f"1{suffix}", plain(120))
    (frame,) = ImageFolder(tmp_path)
    assert frame.image.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(frame.image.astype(int) - plain(120))[:, [0, 10, 50, 63]].max() <= 12  # away from the edge


def test_gray_pictures_become_rgb(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "1.png"), np.full((4, 6), 77, np.uint8))
    (frame,) = ImageFolder(tmp_path)
    np.testing.assert_array_equal(frame.image, np.full((4, 6, 3), 77))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".webp", ".tif"])
def test_truncated_image_is_named(tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"2{suffix}"
    write_image(path, noise(1)[0])
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputError, match=rf"2\{suffix}: not a readable image, or damaged"):
        list(ImageFolder(tmp_path))
    assert "[ERROR" not in capfd.readouterr().err


def test_empty_image_is_named(tmp_path: Path) -> None:
    (tmp_path / "2.jpg").write_bytes(b"")
    with pytest.raises(InputError, match=r"2\.jpg: not a readable image, or damaged; expected jpg, jpeg, png"):
        list(ImageFolder(tmp_path))


def test_other_size_names_the_file_and_both_sizes(tmp_path: Path) -> None:
    write_image(tmp_path / "1.png", plain(1))
    write_image(tmp_path / "2.png", plain(1, height=24, width=32))
    with pytest.raises(InputError, match=r"2\.png: the image is 32x24 pixels; expected 64x48 like 1\.png"):
        list(ImageFolder(tmp_path))


def test_folder_without_images(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no picture")
    with pytest.raises(InputError, match=rf"{tmp_path.name}: the folder holds no image; expected jpg"):
        ImageFolder(tmp_path)


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent: no such folder"):
        ImageFolder(tmp_path / "absent")


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_frame_rate_must_be_positive(tmp_path: Path, rate: float) -> None:
    with pytest.raises(InputError, match=r"frame_rate is .*; expected frames per second from"):
        ImageFolder(tmp_path, rate)


def test_names_of_times_are_in_order_of_time(tmp_path: Path) -> None:
    for number in range(31):
        write_image(tmp_path / f"{1700000000 + number / 30}.png", plain(number))
    assert [int(frame.image[0, -1, 0]) for frame in ImageFolder(tmp_path)] == list(range(31))


def test_ambiguous_order_is_told(tmp_path: Path) -> None:
    for number, name in enumerate(["1.9.png", "1.10.png"]):
        write_image(tmp_path / name, plain(number))
    with pytest.warns(UserWarning, match=r"read as parts, not as decimal numbers: the order is 1\.9, 1\.10"):
        folder = ImageFolder(tmp_path)
    assert [int(frame.image[0, -1, 0]) for frame in folder] == [0, 1]


def test_depth_beside_color_is_left_out_and_told(tmp_path: Path) -> None:
    for number in range(3):
        write_image(tmp_path / f"frame_{number}_color.png", plain(number))
        assert cv2.imwrite(str(tmp_path / f"frame_{number}_depth.png"), np.full((HEIGHT, WIDTH), 900, np.uint16))
    with pytest.warns(UserWarning, match=r"3 16-bit pictures of one channel are taken for depth and left out of the 3"):
        folder = ImageFolder(tmp_path)
    assert [int(frame.image[0, -1, 0]) for frame in folder] == [0, 1, 2]


def test_color_with_16_bits_is_no_depth(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "1.png"), np.full((4, 6, 3), 77 << 8, np.uint16))
    (frame,) = ImageFolder(tmp_path)
    np.testing.assert_array_equal(frame.image, np.full((4, 6, 3), 77))


def test_folder_of_depth_alone_is_refused(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "1.png"), np.full((4, 6), 900, np.uint16))
    with pytest.raises(InputError, match=r"holds only 16-bit pictures of one channel, which are depth; expected color"):
        ImageFolder(tmp_path)
