"""Settings of the loop, as they are given on the command line."""

from dataclasses import dataclass
from typing import final

from geoskill.schema import Config, setting


@final
@dataclass
class ServoConfig(Config):
    """Settings of one step of the loop (:mod:`geoskill.control.servo`)."""

    gain: float = setting(0.35, "Share of the error that a step removes.", above=0, at_most=1)
    smoothing: float = setting(0.5, "Share of the last command in the next one.", at_least=0, below=1)
    step_mm: float = setting(12.0, "Largest displacement of one step along any axis, mm.", above=0, at_most=1000)
    step_deg: float = setting(3.4, "Largest turn of one step about any axis, degrees.", above=0, at_most=90)
    travel_mm: float = setting(350.0, "Largest way from the start along any axis, mm.", above=0, at_most=1e5)
    travel_deg: float = setting(75.0, "Largest turn from the start about any axis, degrees.", above=0, at_most=360)
    down_mm: float = setting(350.0, "Largest way down from the start, mm.", above=0, at_most=1e5)
    min_confidence: float = setting(
        0.2, "Confidence of an association below which it does not drive.", at_least=0, at_most=1
    )
    descend_below_px: float = setting(
        25.0, "RMS of the errors below which a guarded descent goes down, pixels.", above=0
    )
    descend_ratio: float = setting(0.5, "Speed of a guarded descent, as a share of the limit.", above=0, at_most=1)
    settle_px: float = setting(
        1.1, "RMS of the errors below which the loop is done, pixels: 2.2 standard deviations of detection.", above=0
    )
    terminal_frames: int = setting(30, "Frames with falling gain at the end, which average noise.", at_least=0)
    hold_frames: int = setting(20, "Frames for which the actor waits without associations: two seconds.", at_least=1)
    retreat_mm: float = setting(30.0, "How far the actor then goes back the way it came, mm.", at_least=0)
    max_frames: int = setting(140, "Frames after which the loop gives up, exploration included.", at_least=1)
    rate_hz: float = setting(10.0, "Frames per second, for twists and for watching the time.", above=0)
