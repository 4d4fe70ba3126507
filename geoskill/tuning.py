"""Tuning values of tracking, of synthetic negatives and of selection over time, with advice on changing them.

They are part of the configuration (:mod:`geoskill.config`), and arguments of the code that uses them.
"""

from dataclasses import dataclass, field
from typing import final

from geoskill.schema import Config, setting


@final
@dataclass
class TrajectoryConfig(Config):
    """Long-range trajectories of a demonstration's features (:mod:`geoskill.tracking.trajectories`)."""

    anchors: int = setting(
        16, "Past frames at which positions are kept, evenly spaced over the demonstration.", at_least=1
    )
    position_tolerance_ratio: float = setting(
        0.01,
        "Largest distance of a detection from the end of the flow, as a ratio of the shorter side of the frame: some"
        " pixels of error.",
        at_least=0,
    )
    similarity_ratio: float = setting(
        0.5,
        "Largest difference of similar descriptors, as a ratio of the median distance between different features.",
        at_least=0,
    )
    max_gap_hops: int = setting(
        32,
        "Hops of `demonstration.gap` frames for which a feature may go undetected; after a longer gap it is rarely"
        " found again.",
        at_least=1,
    )
    rest_px: float = setting(
        2.0,
        "A lost feature that moved no farther than this since its frame is taken to be covered and at rest.",
        at_least=0,
    )


@final
@dataclass
class NegativesConfig(Config):
    """Pictures from which synthetic negative features are extracted (:mod:`geoskill.data.negatives`)."""

    source_frames: int = setting(
        16,
        "Frames of the demonstration, spread over it, that give negatives: mirrored, inverted, and both.",
        at_least=1,
    )
    leaves_per_frame: int = setting(3, "Pictures of dead leaves per source frame.", at_least=0)


@final
@dataclass
class CoMotionConfig(Config):
    """Detection of co-motion (:mod:`geoskill.tracking.co_motion`).

    Window, displacement and difference were chosen by measurement on simulated sorting and folding.
    """

    window_frames: int = setting(
        12,
        "Past frames compared: less than half a second of video, in which a hand or an arm at work visibly moves"
        " (docs/experiments/co-motion.md).",
        at_least=1,
    )
    min_displacement_ratio: float = setting(
        0.02,
        "Smallest displacement of a moving feature, as a ratio of the shorter side of the frame: ten pixels of VGA,"
        " several times the error of flow over the window (docs/experiments/co-motion.md).",
        at_least=0,
    )
    max_difference_ratio: float = setting(
        0.15,
        "Largest difference of two displacements in co-motion, as a ratio of the longer one: 9 degrees, or a seventh in"
        " depth (docs/experiments/co-motion.md).",
        at_least=0,
        at_most=1,
    )
    min_background_ratio: float = setting(
        0.5,
        "Share of the picture that has to fit one motion, the background's; an object that fills most of the picture is"
        " taken for it, and near objects do not rest when the camera moves past them (docs/experiments/co-motion.md).",
        at_least=0,
        at_most=1,
    )
    # Flow is never computed at a shorter side of more than 480 pixels.
    working_side: int = setting(
        240,
        "Shorter side in pixels at which frames are compared, half of VGA for speed; smaller frames are enlarged,"
        " because flow is smooth over some pixels and would drag along what rests beside a moving object.",
        at_least=16,
        at_most=480,
    )


@final
@dataclass
class InnovationConfig(Config):
    """Unexplained steps of an error, and for how long they are unsure (:mod:`geoskill.skill.innovation`)."""

    max_sigma: float = setting(
        5.0,
        "Largest step that noise explains, in standard deviations: of normal noise, one in two million is larger.",
        above=0,
    )
    goal_frames: int = setting(
        3,
        "Frames for which an association with a goal error is unsure after a step: a tenth of a second"
        " (docs/experiments/errors.md).",
        at_least=1,
    )
    frames: int = setting(
        30,
        "The same without goal error: a second, as there is less to check it by (docs/experiments/errors.md).",
        at_least=1,
    )


@final
@dataclass
class TemporalFilterConfig(Config):
    """Selection over time (:mod:`geoskill.skill.temporal_filter`)."""

    tolerated_margin: float = setting(
        0.3,
        "Margin of another association, in standard deviations of the frame's scores, that does not count against the"
        " selected one (docs/experiments/switches.md).",
        at_least=0,
    )
    patience: float = setting(
        2.0,
        "Largest sum over frames of the margin beyond the tolerated one; a wrong selection stays as long, too"
        " (docs/experiments/switches.md).",
        at_least=0,
    )
    max_missed_frames: int = setting(
        3,
        "Consecutive frames, a tenth of a second of video, in which a tracked feature may go undetected; with more of"
        " them, wrong associations stay, as they are rarely detected again (docs/experiments/switches.md).",
        at_least=0,
    )
    co_motion_penalty: float = setting(
        2.0,
        "Penalty of associations whose nodes move together, in standard deviations of the frame's scores: those of"
        " look-alikes differ by less, and a best score without look-alikes stays the best"
        " (docs/experiments/co-motion.md).",
        at_least=0,
    )
    co_motion: CoMotionConfig = field(default_factory=CoMotionConfig)
    innovation: InnovationConfig = field(default_factory=InnovationConfig)
