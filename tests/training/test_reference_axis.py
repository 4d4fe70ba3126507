"""The direction by which segments are directed."""

import math
from typing import Any

import pytest
import torch

from geoskill.training.calibration import calibrate, is_calibration, uncalibrated
from geoskill.training.reference_axis import axis_of

Training = Any


def unit(*degrees: float) -> torch.Tensor:
    return torch.tensor([[math.cos(math.radians(own)), math.sin(math.radians(own))] for own in degrees])


@pytest.mark.parametrize("turned", [0.0, 180.0])
def test_axis_is_along_lines_of_one_direction(turned: float) -> None:
    axis = axis_of(unit(29 + turned, 30, 31), torch.ones(3))
    assert abs(float(axis @ unit(30)[0])) > 0.999


def test_axis_is_across_no_edge_of_a_box() -> None:
    axis = axis_of(unit(0, 90, 0), torch.tensor([1.0, 1.0, 0.5]))
    assert (unit(0, 90) @ axis).abs().min() > math.sin(math.radians(30))


def test_axis_counts_lines_by_their_weight() -> None:
    axis = axis_of(unit(0, 90), torch.tensor([1.0, 0.01]))
    assert abs(float(axis[0])) > 0.98


def test_calibrate_sets_the_axis_of_members_with_lines(training: Training) -> None:
    members = training.members()
    before = uncalibrated(members, prefix="members.")
    assert {key for key in before if not is_calibration(key)} == set()
    calibrate(members, training.demonstration)
    assert members["p2p_sift"].reference_axis.tolist() == [1.0, 0.0]
    axis = members["p2l_sift_lbd"].reference_axis
    assert float(axis.norm()) == pytest.approx(1.0)
    assert axis.tolist() != [1.0, 0.0]
    again = uncalibrated(members, prefix="members.")
    assert all(torch.equal(before[key], again[key]) for key in before)
