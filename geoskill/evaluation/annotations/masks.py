"""Folders of masks, as SAM 2 and other trackers of segments write them: a PNG for each frame.

Either the PNGs are in one folder, and their values are numbers of objects, 0 outside of all (DAVIS; SAM 2's
``vos_inference.py``); or each object has a folder of its own, and whatever is not 0 is the object
(``--per_obj_png_file``).
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from geoskill.errors import InputError
from geoskill.evaluation.annotations.mask_picture import decoded_mask
from geoskill.evaluation.annotations.picture import LabeledPicture, Shape, shape_of_mask
from geoskill.evaluation.regions import size_text

# More values are no numbers of objects, but a gray picture.
MAX_OBJECTS = 256


def mask_files(folder: Path) -> list[Path]:
    """Return the masks in a folder, and in the folders in it."""
    return sorted([*folder.glob("*.png"), *folder.glob("*/*.png")])


def masked_pictures(folder: Path) -> Iterator[LabeledPicture]:
    """Yield the shapes of every frame; a mask without anything says that everything is out of view.

    Raises:
        InputError: when a mask cannot be read, or those of one frame differ in size.
    """
    by_name: dict[str, list[Path]] = {}
    for path in mask_files(folder):
        by_name.setdefault(path.name, []).append(path)
    for name, paths in by_name.items():
        shapes: list[Shape] = []
        size: tuple[int, int] | None = None
        for path in paths:
            values = _read(path)
            own_size = values.shape[1], values.shape[0]
            size = size or own_size
            if own_size != size:
                raise InputError(f"{path}: {size_text(own_size)}; expected {size_text(size)} like others")
            if path.parent == folder:
                shapes += [shape_of_mask(str(path), str(own), values == own) for own in _objects(path, values)]
            else:
                shapes.append(shape_of_mask(str(path), path.parent.name, values > 0))
        assert size is not None
        yield LabeledPicture(str(paths[0]), name, None, size, shapes)


def _read(path: Path) -> np.ndarray:
    try:
        return decoded_mask(str(path), path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); expected a mask") from error


def _objects(path: Path, values: np.ndarray) -> list[int]:
    objects = [int(own) for own in np.unique(values) if own != 0]
    if len(objects) > MAX_OBJECTS:
        raise InputError(f"{path}: has {len(objects)} values; expected numbers of at most {MAX_OBJECTS} objects")
    return objects
