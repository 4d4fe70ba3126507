"""Pictures with depth beside them, from a folder.

::

    DIR/*.png    or DIR/rgb/, DIR/color/    the pictures
    DIR/depth/*.png                         16 bits, one channel; or *.npz with one array each
    DIR/camera.yaml                         intrinsics (geoskill.io.camera_file)

So write RealSense's tools, TUM (pairs by time, a depth_factor of 5000) and HRT1 (cam_K.txt).
"""

import warnings
from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.errors import InputError
from geoskill.geometry.depth_registration import registered
from geoskill.io.archive import require_uninflated
from geoskill.io.camera_file import CameraFile, find_camera_file, read_camera_file
from geoskill.io.file_order import DECIMAL, NUMBERS
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource, quiet_opencv, size_text, validate_frame_rate
from geoskill.io.image_folder import IMAGE_SUFFIXES, ordered_pictures, read_image

DEPTH: Final = "depth"
PICTURES: Final = (".", "rgb", "color")
SUFFIXES: Final = (".png", ".npz")
MAX_APART_S: Final = 0.02
"""Pictures and depth whose names are times belong together up to this difference, as TUM's own tool has it."""
PLAUSIBLE_M: Final = (0.05, 20.0)


def has_depth(folder: Path) -> bool:
    """Return whether a folder has pictures of depth in ``depth/``, and the intrinsics without which they are no use.

    Warns where only the latter are missing.
    """
    if not (folder / DEPTH).is_dir():
        return False
    if find_camera_file(folder) is None:
        warnings.warn(f"{folder}: {DEPTH}/ is left out; expected intrinsics in camera.yaml beside it", stacklevel=3)
        return False
    return True


@final
class DepthFolder(FrameSource):
    """The pictures of a folder with their depth, aligned with them; in the order of :class:`ImageFolder`.

    Pictures are taken as they are stored, whatever orientation their EXIF data tells: the intrinsics are of these.

    Args:
        path: the folder; see above.
        frame_rate: frames per second; frame ``i`` has the time ``i / frame_rate``.

    Raises:
        InputError: when there are no pictures, one has no depth, or the intrinsics cannot be read.
    """

    def __init__(self, path: str | Path, frame_rate: float = DEFAULT_FRAME_RATE) -> None:
        self._folder = Path(path)
        self._frame_rate = validate_frame_rate(frame_rate)
        file = find_camera_file(self._folder)
        if file is None:
            raise InputError(f"{path}: has no intrinsics; expected camera.yaml")
        self._camera_path, self._camera = file, read_camera_file(file)
        pictures = next((found for name in PICTURES if (found := _pictures(self._folder / name))), [])
        if not pictures:
            raise InputError(f"{path}: holds no picture; expected some in it, in rgb/ or in color/, beside {DEPTH}/")
        self._pairs = _paired(self._folder, pictures)

    @property
    def name(self) -> str:
        """Return the path."""
        return str(self._folder)

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        first: tuple[int, ...] | None = None
        plausible = False
        for index, (picture, depth) in enumerate(self._pairs):
            image = read_image(picture, as_stored=True)
            first = first or image.shape
            if image.shape != first:
                raise InputError(
                    f"{picture}: the image is {size_text(image.shape)} pixels; expected {size_text(first)} like"
                    f" {self._pairs[0][0].name}, since the frames of a folder must have one size"
                )
            measured = read_depth(depth, self._camera.depth_factor)
            if not plausible and np.isfinite(measured).any():
                _require_plausible(depth, measured, self._camera_path, self._camera.depth_factor)
                plausible = True
            yield Frame(
                index, index / self._frame_rate, image, self._aligned(depth, measured, image.shape), self._camera.color
            )

    def _aligned(
        self, path: Path, depth_m: Float32[np.ndarray, "rows columns"], shape: tuple[int, ...]
    ) -> Float32[np.ndarray, "height width"]:
        camera: CameraFile = self._camera
        if camera.depth is not None:
            return registered(depth_m, camera.depth, camera.color, camera.depth_to_color, (shape[1], shape[0]))
        if depth_m.shape != shape[:2]:
            raise InputError(
                f"{path}: the depth is {size_text(depth_m.shape)} pixels; expected {size_text(shape)} like the picture,"
                f" or the depth's own intrinsics as depth: in {self._camera_path.name}"
            )
        return depth_m


def read_depth(path: Path, factor: float) -> Float32[np.ndarray, "rows columns"]:
    """Read a picture of depth in meters, NaN where there is none: a 16-bit PNG, or an array in an NPZ.

    Args:
        path: of the file.
        factor: value at one meter; arrays of floating point are in meters already.

    Raises:
        InputError: when it is no such file.
    """
    try:
        values = _read_array(path) if path.suffix.lower() == ".npz" else _read_png(path)
    except (OSError, ValueError, KeyError, cv2.error) as error:
        message = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read ({message}); expected a picture of depth") from error
    if (
        values is None
        or values.ndim != 2
        or values.size == 0
        or values.dtype not in (np.uint16, np.float32, np.float64)
    ):
        found = "damaged" if values is None else f"{values.dtype} {list(values.shape)}"
        raise InputError(f"{path}: is {found}; expected a picture of depth, one channel of 16 bits")
    depth_m = values.astype(np.float32) / np.float32(factor if values.dtype == np.uint16 else 1.0)
    depth_m[~(np.isfinite(depth_m) & (depth_m > 0))] = np.nan
    return depth_m


def _read_png(path: Path) -> np.ndarray | None:
    data = np.frombuffer(path.read_bytes(), np.uint8)
    with quiet_opencv():
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    return None if image is None else np.asarray(image)


def _read_array(path: Path) -> np.ndarray:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
        if len(stored.files) != 1:
            raise ValueError(f"it holds {len(stored.files)} arrays, not one")
        require_uninflated(stored.zip, path.stat().st_size)
        return np.asarray(stored[stored.files[0]])


def _require_plausible(path: Path, depth_m: np.ndarray, camera_path: Path, factor: float) -> None:
    median = float(np.nanmedian(depth_m))
    least, most = PLAUSIBLE_M
    if not least <= median <= most:
        raise InputError(
            f"{path}: the median depth is {median:.3g} m; expected {least:g} to {most:g} m (depth_factor, the value at"
            f" one meter, is {factor:g} in {camera_path.name})"
        )


def _pictures(folder: Path) -> list[Path]:
    if not folder.is_dir():
        return []
    files = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    return ordered_pictures([path for path in files if not path.name.startswith(".")])


def _paired(folder: Path, pictures: Sequence[Path]) -> list[tuple[Path, Path]]:
    """Return every picture with its depth: that of its name, of its number, or of its time.

    Raises:
        InputError: when a picture has none; of those with times, when hardly any has one.
    """
    depths = {
        path.stem: path
        for path in sorted((folder / DEPTH).iterdir())
        if path.suffix.lower() in SUFFIXES and not path.name.startswith(".")
    }
    if not depths:
        raise InputError(f"{folder / DEPTH}: holds no depth; expected .png files of 16 bits, or .npz files")
    if any(picture.stem in depths for picture in pictures):
        return _all_found(folder, pictures, [depths.get(picture.stem) for picture in pictures])
    times = {path: _time(path.stem) for path in [*pictures, *depths.values()]}
    if all(time is not None for time in times.values()):
        return _by_time(folder, pictures, list(depths.values()), times)
    numbered = {_number(stem): path for stem, path in depths.items()}
    return _all_found(folder, pictures, [numbered.get(_number(picture.stem)) for picture in pictures])


def _all_found(folder: Path, pictures: Sequence[Path], depths: Sequence[Path | None]) -> list[tuple[Path, Path]]:
    pairs = [(picture, depth) for picture, depth in zip(pictures, depths, strict=True) if depth is not None]
    missing = [picture.name for picture, depth in zip(pictures, depths, strict=True) if depth is None]
    if missing:
        raise InputError(
            f"{folder}: {len(missing)} of {len(pictures)} pictures have no depth, the first is {missing[0]}; expected a"
            f" file of its name, or of its number, in {DEPTH}/"
        )
    return pairs


def _by_time(
    folder: Path, pictures: Sequence[Path], depths: Sequence[Path], times: Mapping[Path, Decimal | None]
) -> list[tuple[Path, Path]]:
    """Return the pictures that have depth at about their time, the nearest pairs first, none of them twice."""
    by_time = sorted((time, path) for path in depths if (time := times[path]) is not None)
    candidates = []
    for picture in pictures:
        time = times[picture]
        assert time is not None
        place = bisect_left(by_time, (time, picture))
        for other, path in by_time[max(0, place - 2) : place + 2]:
            if abs(other - time) <= MAX_APART_S:
                candidates.append((abs(other - time), picture, path))
    nearest: dict[Path, Path] = {}
    taken: set[Path] = set()
    for _, picture, path in sorted(candidates):
        if picture not in nearest and path not in taken:
            nearest[picture] = path
            taken.add(path)
    pairs = [(picture, nearest[picture]) for picture in pictures if picture in nearest]
    if len(pairs) < len(pictures) / 2:
        raise InputError(
            f"{folder}: {len(pairs)} of {len(pictures)} pictures have depth within {MAX_APART_S:g} s; expected files of"
            f" their times in {DEPTH}/"
        )
    if len(pairs) < len(pictures):
        warnings.warn(f"{folder}: {len(pictures) - len(pairs)} pictures without depth are left out", stacklevel=4)
    return pairs


def _time(stem: str) -> Decimal | None:
    return Decimal(stem) if DECIMAL.fullmatch(stem) else None


def _number(stem: str) -> int | str:
    numbers = NUMBERS.findall(stem.lower())
    return int(numbers[-1]) if numbers and numbers[-1].isdigit() else stem
