"""Image sensor: blur, exposure, noise and compression of rendered images."""

import cv2
import numpy as np
from jaxtyping import UInt8

Image = UInt8[np.ndarray, "height width 3"]

BLUR_PX = 0.55
READ_NOISE, SHOT_NOISE = 1.2, 0.16
JPEG_QUALITY = 94


def expose(image: Image, exposure: float, rng: np.random.Generator) -> Image:
    """Apply lens blur, exposure and sensor noise to a rendered RGB image.

    The variance of the noise is a constant (read noise) plus a share of the intensity (shot noise).

    Args:
        image: RGB, 0 to 255.
        exposure: factor on the intensity.
        rng: draws the noise.
    """
    light = cv2.GaussianBlur(image, (0, 0), BLUR_PX).astype(np.float32) * np.float32(exposure)
    noise = rng.standard_normal(image.shape, np.float32)
    # Demosaicing correlates neighboring pixels; the factor restores the variance that the blur removes.
    noise = cv2.GaussianBlur(noise, (0, 0), 0.5) * np.float32(1.7)
    deviation = np.sqrt(READ_NOISE**2 + SHOT_NOISE**2 * np.maximum(light, 0))
    return np.asarray(np.clip(light + deviation * noise + 0.5, 0, 255), np.uint8)


def exposure_drift(frames: int, rng: np.random.Generator) -> np.ndarray:
    """Return one exposure factor per frame: the slow drift of an automatic exposure, by at most 2.5 percent."""
    time = np.linspace(0, 1, frames)
    return 1 + 0.025 * np.sin(2 * np.pi * (rng.uniform(0.5, 1.5) * time + rng.random()))


def compress(image: Image) -> bytes:
    """Encode an RGB image as JPEG."""
    ok, data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert ok
    return data.tobytes()
