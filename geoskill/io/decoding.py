"""Decoding of videos and streams by PyAV (FFmpeg), judged by content and not by name."""

import math
from collections.abc import Iterator

import av

from geoskill.errors import InputError
from geoskill.io.damage import Damage
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, size_text
from geoskill.io.orientation import shown

# As messages list them; what can be decoded decides, not the ending.
VIDEO_TYPES = "mp4, mov, avi, webm, mkv or whatever else PyAV reads"
# FFmpeg's names of formats that it takes for videos, and that are texts drawn as pictures, or single pictures.
TEXTS = ("tty", "bin", "xbin", "adf", "idf")
# A video that is damaged for longer is broken, and so is one of which as much is missing and more than this share.
MAX_DAMAGED_S = 1.0
MAX_MISSING_SHARE = 0.1
# Packets from whose times the frame rate is estimated where the file does not say it.
PACKETS_FOR_RATE = 100


def video_stream(container: av.container.InputContainer, name: str) -> av.VideoStream:
    """Return the main video stream.

    Raises:
        InputError: when there is none, or the file is a text or a single picture.
    """
    stream = container.streams.best("video")
    kind = container.format.name
    if not isinstance(stream, av.VideoStream) or kind in TEXTS:
        raise InputError(f"{name}: the file has no video stream; expected a video ({VIDEO_TYPES})")
    if stream.codec_context is None:
        raise InputError(f"{name}: the video is coded in a way that is not known; expected one that PyAV decodes")
    if kind == "image2" or kind.endswith("_pipe"):
        raise InputError(f"{name}: a single picture; expected a video ({VIDEO_TYPES}) or a folder of images")
    return stream


def nominal_rate(container: av.container.InputContainer, stream: av.VideoStream) -> float:
    """Return the frames per second that the file states, or, where it states none, those of its first frames.

    Reads packets, so that the container cannot be decoded from the beginning afterwards.
    """
    stated = float(stream.guessed_rate or 0)
    if stated > 0 and stream.time_base is not None and stated * stream.time_base < 1:
        return stated
    # FFmpeg gives the clock's rate for what states none, such as 1000 for Matroska's milliseconds.
    times = []
    for packet in container.demux(stream):
        if packet.pts is not None and packet.time_base is not None:
            times.append(float(packet.pts * packet.time_base))
        if len(times) == PACKETS_FOR_RATE:
            break
    duration_s = max(times) - min(times) if times else 0.0
    if duration_s > 0:
        return (len(times) - 1) / duration_s
    return stated or DEFAULT_FRAME_RATE


def decoded_frames(
    container: av.container.InputContainer,
    name: str,
    frame_rate: float,
    *,
    whole: bool,
    start_s: float | None = None,
    strict: bool = False,
) -> Iterator[Frame]:
    """Yield the frames of the main video stream of a container that was just opened, or has been sought.

    Frame times are those stored in the file, relative to the first frame; a frame without a time gets
    ``index / frame_rate``.

    Args:
        container: to be decoded.
        name: of the source, for messages.
        frame_rate: nominal frames per second.
        whole: whether it states its duration, so that one which ends earlier is incomplete.
        start_s: stored time that counts as 0; None for that of the first frame.
        strict: refuse what otherwise is counted and said: damaged frames, errors that the decoder makes up for, and
            missing frames.

    Raises:
        InputError: where the video is cut off, or damaged for more than :data:`MAX_DAMAGED_S`, changes its size, or has
            no frame.
    """
    stream = video_stream(container, name)
    # Messages are attributed to the thread that they come from.
    stream.thread_type, stream.codec_context.thread_count = "NONE", 1
    damage = Damage(name, strict, most_in_a_row=max(1, round(frame_rate * MAX_DAMAGED_S)))
    index = 0
    first_shape: tuple[int, ...] | None = None
    end_s = -math.inf
    try:
        # Audio packets are read too: the duration stored in the file is that of its longest stream.
        packets = container.demux()
        while True:
            with damage.watched(index):
                packet = next(packets, None)
            if packet is None:
                break
            if packet.pts is not None and packet.time_base is not None:
                end_s = max(end_s, float((packet.pts + (packet.duration or 0)) * packet.time_base))
            for decoded in _pictures(stream, packet, damage, index):
                damage.take_in(index, "the frame is damaged" if decoded.is_corrupt else None)
                image = shown(decoded)
                first_shape = first_shape or image.shape
                if image.shape != first_shape:
                    change = f"from {size_text(first_shape)} to {size_text(image.shape)} pixels"
                    raise _broken(name, index, f"the size changes {change}")
                time_s = index / frame_rate
                if decoded.time is not None:
                    start_s = decoded.time - time_s if start_s is None else start_s
                    time_s = decoded.time - start_s
                yield Frame(index, time_s, image)
                index += 1
    except av.error.FFmpegError as error:
        if not whole:
            raise InputError(f"{name}: ends at frame {index} ({error.strerror}); expected it to go on") from error
        raise _broken(name, index, f"cannot be decoded ({error.strerror})") from error
    if index == 0:
        raise InputError(f"{name}: the video is empty; expected at least one frame that can be decoded")
    duration_s, missing_s = _missing(container, end_s)
    if whole and missing_s > max(MAX_DAMAGED_S, MAX_MISSING_SHARE * duration_s):
        raise _broken(name, index, f"{missing_s:.1f} of {duration_s:.1f} s are missing at the end")
    missing = stream.frames - index if stream.frames else int(missing_s * frame_rate - 0.5)
    if whole and missing > max(MAX_DAMAGED_S * frame_rate, MAX_MISSING_SHARE * (index + missing)):
        raise _broken(name, index, f"{missing} of {index + missing} frames are missing at the end")
    damage.conclude(missing if whole else 0, index)


def _pictures(
    stream: av.VideoStream, packet: "av.Packet[av.stream.Stream]", damage: Damage, index: int
) -> list[av.VideoFrame]:
    """Return the pictures in a packet; none where it is one of another stream, or cannot be decoded."""
    if packet.stream.index != stream.index:
        return []
    try:
        with damage.watched(index):
            return stream.decode(packet)
    except av.error.InvalidDataError as error:
        damage.take_in(index, f"cannot be decoded ({error.strerror})")
        return []


def _missing(container: av.container.InputContainer, end_s: float) -> tuple[float, float]:
    """Return the stated duration, and how much of it comes after the last packet; zeros where nothing is stated."""
    if container.duration is None or not math.isfinite(end_s):
        return 0.0, 0.0
    duration_s = container.duration / av.time_base
    start_s = (container.start_time or 0) / av.time_base
    end_stated_s = start_s + duration_s
    # Matroska's duration is that of the segment: some writers count from the first time stamp, others from zero.
    if "matroska" in container.format.name and 0 < start_s < duration_s:
        end_stated_s = duration_s
    return duration_s, end_stated_s - end_s


def _broken(name: str, index: int, reason: str) -> InputError:
    return InputError(f"{name}: the video breaks at frame {index}: {reason}; expected a complete video file")
