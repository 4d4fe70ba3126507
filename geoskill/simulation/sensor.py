"""What a camera adds to the picture of a scene."""

import cv2
import numpy as np
from jaxtyping import UInt8

Image = UInt8[np.ndarray, "height width 3"]

BLUR_PX = 0.55
READ_NOISE, SHOT_NOISE = 1.2, 0.16
JPEG_QUALITY = 94


def expose(image: Image, exposure: float, random: np.random.Generator) -> Image:
    """Lens blur, exposure, and the noise of the sensor: a fixed part, and one that grows with the root of the light."""
    light = cv2.GaussianBlur(image, (0, 0), BLUR_PX).astype(np.float32) * np.float32(exposure)
    noise = random.standard_normal(image.shape, np.float32)
    # Neighboring sites share what the color filter lets through.
    noise = cv2.GaussianBlur(noise, (0, 0), 0.5) * np.float32(1.7)
    spread = np.sqrt(READ_NOISE**2 + SHOT_NOISE**2 * np.maximum(light, 0))
    return np.asarray(np.clip(light + spread * noise + 0.5, 0, 255), np.uint8)


def exposure_course(frames: int, random: np.random.Generator) -> np.ndarray:
    """The slow drift of an automatic exposure, a few percent."""
    time = np.linspace(0, 1, frames)
    return 1 + 0.025 * np.sin(2 * np.pi * (random.uniform(0.5, 1.5) * time + random.random()))


def compress(image: Image) -> bytes:
    """A JPEG."""
    ok, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert ok
    return data.tobytes()
