"""Masks as pictures, whose values are numbers of objects."""

import io
import warnings

import numpy as np
from jaxtyping import Integer
from PIL import Image, UnidentifiedImageError

from geoskill.errors import InputError
from geoskill.evaluation.annotations.picture import MAX_PIXELS


def decoded_mask(origin: str, data: bytes) -> Integer[np.ndarray, "height width"]:
    """Return the values of a PNG: of a palette the entries' numbers, of a gray picture its grays.

    Raises:
        InputError: when it cannot be read, is too large, or has colors beside a palette.
    """
    # OpenCV would give the palette's colors.
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the size is checked here
            picture = Image.open(io.BytesIO(data), formats=["PNG"])
        if picture.width * picture.height > MAX_PIXELS:
            raise InputError(f"{origin}: {picture.width}x{picture.height}; expected at most {MAX_PIXELS} pixels")
        if picture.mode not in ("1", "L", "P", "I", "I;16"):
            raise InputError(f"{origin}: a picture in colors ({picture.mode}); expected a palette or grays, 0 outside")
        return np.asarray(picture).astype(np.int64)
    except (OSError, SyntaxError, ValueError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{origin}: cannot be read as PNG ({error}); expected a mask") from None
