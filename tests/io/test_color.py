"""A chart of pure colors, as files with either of the usual color matrices store it by the standards' formulas."""

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from geoskill.io.video import VideoFile

COLORS = np.array(
    [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255), (255, 255, 255), (0, 0, 0)]
)
# Of luma, Kr and Kb: ITU-R BT.601, 2.5.1, and BT.709, 3.2; the numbers of ISO/IEC 23091-2 that name them in a file.
MATRICES = {"BT.601": (0.299, 0.114, 6), "BT.709": (0.2126, 0.0722, 1)}
LIMITED, FULL = 1, 2


def stored(red: float, blue: float, color_range: int) -> np.ndarray:
    """Return Y, Cb and Cr of the colors as bytes."""
    weights = np.array([red, 1 - red - blue, blue])
    luma = COLORS @ weights / 255
    chroma = [(COLORS[:, c] / 255 - luma) / (2 * (1 - weight)) for c, weight in ((2, blue), (0, red))]
    luma_scale, luma_offset, chroma_scale = (219, 16, 224) if color_range == LIMITED else (255, 0, 255)
    planes = [luma_offset + luma_scale * luma, *(128 + chroma_scale * plane for plane in chroma)]
    return np.clip(np.stack(planes).round(), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("color_range", [LIMITED, FULL])
@pytest.mark.parametrize("standard", MATRICES)
def test_colors_are_those_that_were_filmed(tmp_path: Path, standard: str, color_range: int) -> None:
    red, blue, number = MATRICES[standard]
    planes = np.repeat(stored(red, blue, color_range)[:, None, :], 16, axis=2)  # [3, 1, 128]
    picture = np.ascontiguousarray(np.broadcast_to(planes, (3, 64, 128)))
    with av.open(str(tmp_path / "chart.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"qp": "1"})
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = 128, 64, "yuv444p"
        context = stream.codec_context
        context.colorspace, context.color_range = number, color_range
        frame = av.VideoFrame.from_ndarray(picture, format="yuv444p")
        frame.pts, frame.time_base = 0, Fraction(1, 30)
        frame.colorspace, frame.color_range = number, color_range
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    (read,) = VideoFile(tmp_path / "chart.mp4")
    np.testing.assert_allclose(read.image[32, 8::16].astype(int), COLORS, atol=6)
