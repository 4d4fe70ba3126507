"""Frames from a folder of images."""

import struct
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.io.file_order import in_order
from geoskill.io.frames import (
    DEFAULT_FRAME_RATE,
    Frame,
    FrameSource,
    bgr_to_rgb,
    quiet_opencv,
    size_text,
    validate_frame_rate,
)

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
# As messages list them.
IMAGE_TYPES = ", ".join(suffix.removeprefix(".") for suffix in IMAGE_SUFFIXES)


@final
class ImageFolder(FrameSource):
    """The images of a folder in the order of the numbers in their names, without hidden files and pictures of depth.

    The order is that of :func:`~geoskill.io.file_order.in_order`. PNG files of one channel with 16 bits hold depth, or
    other measurements, and are never frames. A warning says when the order is ambiguous, or such files are left out.

    Args:
        path: the folder.
        frame_rate: frames per second; frame ``i`` has the time ``i / frame_rate``.

    Raises:
        InputError: when the folder does not exist or holds no image, or the frame rate is not positive.
    """

    def __init__(self, path: str | Path, frame_rate: float = DEFAULT_FRAME_RATE) -> None:
        self._folder = Path(path)
        self._frame_rate = validate_frame_rate(frame_rate)
        if not self._folder.is_dir():
            raise InputError(f"{path}: no such folder; expected a folder of images ({IMAGE_TYPES})")
        found = [
            file
            for file in self._folder.iterdir()
            if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
        ]
        if not found:
            raise InputError(f"{path}: the folder holds no image; expected {IMAGE_TYPES} files")
        self._paths, ambiguity = _ordered([file for file in found if not _is_depth(file)])
        left_out = len(found) - len(self._paths)
        if not self._paths:
            raise InputError(
                f"{path}: holds only 16-bit pictures of one channel, which are depth; expected color images"
            )
        if ambiguity is not None:
            warnings.warn(f"{path}: {ambiguity}", stacklevel=2)
        if left_out:
            warnings.warn(
                f"{path}: {left_out} 16-bit pictures of one channel are taken for depth and left out of the"
                f" {len(self._paths)} frames",
                stacklevel=2,
            )

    @property
    def name(self) -> str:
        """Return the path."""
        return str(self._folder)

    @property
    def stems(self) -> list[str]:
        """Return the names of the images, in the order of the frames, without their endings."""
        return [path.stem for path in self._paths]

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        first_shape: tuple[int, ...] | None = None
        for index, path in enumerate(self._paths):
            image = read_image(path)
            first_shape = first_shape or image.shape
            if image.shape != first_shape:
                raise InputError(
                    f"{path}: the image is {size_text(image.shape)} pixels; expected {size_text(first_shape)} like "
                    f"{self._paths[0].name}, since the frames of a folder must have one size"
                )
            yield Frame(index, index / self._frame_rate, image)


def _ordered(paths: list[Path]) -> tuple[list[Path], str | None]:
    by_stem: dict[str, list[Path]] = {}
    for path in sorted(paths):
        by_stem.setdefault(path.stem, []).append(path)
    stems, ambiguity = in_order(by_stem)
    return [path for stem in stems for path in by_stem[stem]], ambiguity


def _is_depth(path: Path) -> bool:
    """Return whether a file is a PNG of one channel with 16 bits; one that cannot be read is left to its reading."""
    if path.suffix.lower() != ".png":
        return False
    try:
        with path.open("rb") as file:
            header = file.read(26)
    except OSError:
        return False
    # ISO/IEC 15948, 11.2.2: signature, length and name of the first chunk, width, height, bit depth, color type.
    return (
        header[:8] == b"\x89PNG\r\n\x1a\n" and header[12:16] == b"IHDR" and struct.unpack(">BB", header[24:]) == (16, 0)
    )


def ordered_pictures(files: list[Path]) -> list[Path]:
    """Return those of some files that are pictures of color, in their order; a warning says when it is ambiguous."""
    ordered, ambiguity = _ordered([file for file in files if not _is_depth(file)])
    if ambiguity is not None:
        warnings.warn(f"{files[0].parent}: {ambiguity}", stacklevel=4)
    return ordered


def read_image(path: Path, *, as_stored: bool = False) -> UInt8[np.ndarray, "height width 3"]:
    """Read a picture as RGB.

    Args:
        path: of the file.
        as_stored: do not turn it as its EXIF data say.

    Raises:
        InputError: when it cannot be read.
    """
    flags = cv2.IMREAD_COLOR | (cv2.IMREAD_IGNORE_ORIENTATION if as_stored else 0)
    try:
        # Read by Python, because OpenCV cannot open every file name on every system.
        data = np.frombuffer(path.read_bytes(), np.uint8)
        with quiet_opencv():
            image = cv2.imdecode(data, flags) if data.size else None
    except (OSError, cv2.error) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected an image") from error
    if image is None:
        raise InputError(f"{path}: not a readable image, or damaged; expected {IMAGE_TYPES}")
    return bgr_to_rgb(image)
