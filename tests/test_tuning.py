"""Tuning values: reached from Python and from the command line, and passed on to the code that uses them."""

from collections.abc import Sequence
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from geoskill.cli.compose import compose_training
from geoskill.cli.inputs import selection
from geoskill.cli.schemas import COMMANDS, markdown_reference
from geoskill.config import DemonstrationConfig, InferenceConfig, SelectionConfig, TrainConfig
from geoskill.errors import InputError
from geoskill.schema import Config, as_plain, flatten
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec
from geoskill.training.prepare import prepare
from geoskill.tuning import CoMotionConfig, NegativesConfig, TemporalFilterConfig, TrajectoryConfig

DEFAULTS = {
    TrajectoryConfig: {
        "anchors": 16,
        "position_tolerance_ratio": 0.01,
        "similarity_ratio": 0.5,
        "max_gap_hops": 32,
        "rest_px": 2.0,
    },
    NegativesConfig: {"source_frames": 16, "leaves_per_frame": 3},
    CoMotionConfig: {
        "window_frames": 12,
        "min_displacement_ratio": 0.02,
        "max_difference_ratio": 0.15,
        "min_background_ratio": 0.5,
        "working_side": 240,
    },
    TemporalFilterConfig: {
        "tolerated_margin": 0.3,
        "patience": 2.0,
        "max_missed_frames": 3,
        "co_motion_penalty": 2.0,
    },
}


@pytest.mark.parametrize("schema", DEFAULTS, ids=lambda schema: schema.__name__)
def test_defaults_are_those_that_were_measured(schema: type[Config]) -> None:
    plain = {name: value for name, value in as_plain(schema()).items() if not isinstance(value, dict)}
    assert plain == DEFAULTS[schema]
    assert all(own.metadata["help"].endswith(".") for _, own, _ in flatten(schema))


@pytest.mark.parametrize("command", ["train", "infer", "evaluate"])
def test_commands_have_every_setting_of_the_filter(command: str) -> None:
    keys = {key for key, _, _ in flatten(COMMANDS[command])}
    assert {f"inference.filter.{name}" for name in DEFAULTS[TemporalFilterConfig]} <= keys
    assert {f"inference.filter.co_motion.{name}" for name in DEFAULTS[CoMotionConfig]} <= keys


def test_reference_has_the_settings() -> None:
    text = markdown_reference()
    for key in (
        "demonstration.trajectory.anchors",
        "demonstration.negatives.source_frames",
        "inference.filter.patience",
    ):
        assert f"| `{key}` |" in text


def test_overrides_of_the_command_line_reach_the_settings() -> None:
    config = compose_training(
        "inference.filter.patience=3",
        "inference.filter.co_motion.window_frames=6",
        "demonstration.trajectory.anchors=8",
        "demonstration.negatives.leaves_per_frame=0",
    ).learning()
    assert config.inference.filter == TemporalFilterConfig(patience=3, co_motion=CoMotionConfig(window_frames=6))
    assert config.demonstration.trajectory == TrajectoryConfig(anchors=8)
    assert config.demonstration.negatives == NegativesConfig(leaves_per_frame=0)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("inference.filter.patience=-0.5", "a number of at least 0"),
        ("inference.filter.co_motion.window_frames=0", "a whole number of at least 1"),
        ("demonstration.trajectory.anchors=0", "a whole number of at least 1"),
        ("demonstration.negatives.source_frames=0", "a whole number of at least 1"),
    ],
)
def test_overrides_out_of_range_are_refused(override: str, expected: str) -> None:
    with pytest.raises(InputError) as refusal:
        compose_training(override)
    assert str(refusal.value) == f"{override}: expected {expected}"


@pytest.mark.usefixtures("annotations_unchecked")
def test_wrong_values_are_refused_in_python() -> None:
    with pytest.raises(InputError, match=r"^patience=-1: expected a number of at least 0$"):
        TemporalFilterConfig(patience=-1)
    with pytest.raises(InputError, match=r"^window_frames=1.5: expected a whole number"):
        CoMotionConfig(window_frames=1.5)  # type: ignore[arg-type]


@pytest.mark.parametrize("schema", [SelectionConfig, InferenceConfig])
def test_selection_passes_the_filter_on(
    spec: SkillSpec, monkeypatch: pytest.MonkeyPatch, schema: type[SelectionConfig] | type[InferenceConfig]
) -> None:
    made = Mock()
    monkeypatch.setattr("geoskill.cli.inputs.TemporalFilter", made)
    skill = Skill(build_skill(spec), spec, Provenance(("tiles",), (160, 120), date="", version="", seed=0))
    selection(skill, schema(filter=TemporalFilterConfig(patience=5.0)))
    made.assert_called_once_with(skill, TemporalFilterConfig(patience=5.0))


def test_prepare_passes_settings_on(spec: SkillSpec, demonstration_frames: Sequence[np.ndarray]) -> None:
    config = TrainConfig(
        demonstration=DemonstrationConfig(
            num_negatives=1,
            trajectory=TrajectoryConfig(anchors=3),
            negatives=NegativesConfig(source_frames=2, leaves_per_frame=0),
        )
    )
    reports = {}

    def progress(items: Any, text: str) -> Any:
        reports[text] = list(items)
        return items

    frames = np.stack(demonstration_frames[:6])
    demonstrations, provenance = prepare(config, [frames], build_skill(spec), progress, None)
    for graphs in demonstrations[0].values():
        assert graphs["first"].point_anchor_xy.shape[1] == 3
    assert reports["finding negatives"] == [0, 5]
    assert provenance.configuration["demonstration"]["trajectory"]["anchors"] == 3
