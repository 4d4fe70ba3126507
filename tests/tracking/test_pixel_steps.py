"""When pixels of drawn pictures change, and that only lasting changes count."""

import numpy as np
import pytest

from geoskill.tracking import pixel_steps as module
from geoskill.tracking.pixel_steps import MAX_PICTURES, PixelSteps, pixel_steps

GROUND, THING, HAND = 90, 200, 30
FRAMES, STEP = 20, 8
PLACE = (slice(10, 22), slice(12, 30))


def pictures(values: list[int]) -> list[np.ndarray]:
    """Return gray pictures in which a place takes these values, one after the other."""
    result = []
    for value in values:
        picture = np.full((40, 60, 3), GROUND, np.uint8)
        picture[PLACE] = value
        result.append(picture)
    return result


def inner(values: np.ndarray) -> np.ndarray:
    """Return the values of the place without its border, which the blur mixes with the ground."""
    return values[..., 13:19, 15:27]


def steps_of(values: list[int]) -> PixelSteps:
    return pixel_steps(pictures(values))


def test_a_step_is_found_where_it_happens() -> None:
    steps = steps_of([THING] * STEP + [GROUND] * (FRAMES - STEP))
    assert inner(steps.changed).all()
    assert (inner(steps.step) == STEP).all()
    assert (inner(steps.inconsistency) == 0).all()
    assert not steps.changed[:5].any(), "the ground does not change"


def test_what_passes_by_contradicts_in_its_own_pictures_only() -> None:
    steps = steps_of([THING] * STEP + [HAND] * 3 + [GROUND] * (FRAMES - STEP - 3))
    np.testing.assert_allclose(inner(steps.inconsistency), 3 / FRAMES)
    assert ((inner(steps.step) >= STEP) & (inner(steps.step) <= STEP + 3)).all()


def test_a_pixel_that_changes_back_and_forth_is_inconsistent() -> None:
    steps = steps_of([THING, THING, *[GROUND, THING] * 8, GROUND, GROUND])
    np.testing.assert_allclose(inner(steps.inconsistency), 8 / FRAMES)


def test_a_change_of_light_is_no_change_of_a_place() -> None:
    frames = [np.full((40, 60, 3), 90 + 3 * t, np.uint8) for t in range(FRAMES)]
    steps = pixel_steps(frames)
    assert not steps.changed.any()
    assert (steps.inconsistency == 1).all()
    assert (steps.step == 0).all()


def test_pictures_are_exposed_as_the_first() -> None:
    """A camera that turns darker and redder by and by: what stays, stays alike, and the step is where it was."""
    steady = pictures([THING] * STEP + [GROUND] * (FRAMES - STEP))
    gains = np.linspace([1.0, 1.0, 1.0], [0.85, 0.7, 0.7], FRAMES)
    shifting = [np.uint8(np.round(picture * gain)) for picture, gain in zip(steady, gains, strict=True)]
    steps, expected = pixel_steps(shifting), pixel_steps(steady)
    np.testing.assert_array_equal(steps.changed, expected.changed)
    np.testing.assert_array_equal(inner(steps.step), inner(expected.step))
    np.testing.assert_allclose(steps.after, expected.after, atol=2.0)
    assert not steps.moving[:, :5].any()


def test_a_black_picture_keeps_its_exposure() -> None:
    black = pixel_steps([np.zeros((40, 60, 3), np.uint8)] * FRAMES)
    assert not black.changed.any()
    assert np.isfinite(black.before).all()


def test_pixels_look_like_either_end_until_and_from_the_step() -> None:
    steps = steps_of([THING] * STEP + [HAND] * 2 + [GROUND] * (FRAMES - STEP - 2))
    assert inner(steps.like_before).all(axis=(1, 2)).tolist() == [t < STEP for t in range(FRAMES)]
    assert inner(steps.like_after).all(axis=(1, 2)).tolist() == [t >= STEP + 2 for t in range(FRAMES)]
    assert inner(steps.moving).all(axis=(1, 2)).tolist() == [t in (STEP, STEP + 2) for t in range(FRAMES)]


def test_a_long_video_is_compared_at_evenly_spaced_pictures() -> None:
    count = 2 * MAX_PICTURES
    steps = steps_of([THING] * (count // 2) + [GROUND] * (count // 2))
    assert len(steps.frames) == MAX_PICTURES
    assert steps.frames[0] == 0
    assert steps.frames[-1] == count - 1
    assert steps.frames[int(inner(steps.step)[0, 0])] == pytest.approx(count // 2, abs=2)
    assert [steps.nearest(frame) for frame in (0, count - 1)] == [0, MAX_PICTURES - 1]


def test_large_pictures_are_reduced() -> None:
    large = [np.kron(picture, np.ones((12, 12, 1), np.uint8)) for picture in pictures([THING] * 4 + [GROUND] * 4)]
    steps = pixel_steps(large)
    assert min(steps.changed.shape) == module.WORKING_SIDE
    assert steps.step[steps.changed].min() == steps.step[steps.changed].max() == 4
