"""Pairs of the first picture, followed by trackers."""

import numpy as np

from geoskill.cli.tracked_pairs import TrackedPairs
from tests.control.small_loops import pair


def test_pairs_of_the_first_picture_are_followed() -> None:
    texture = np.random.default_rng(0).integers(0, 256, (120, 160, 3), np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    first, second = texture[:400, :500].copy(), texture[3:403, 5:505].copy()
    tracked = TrackedPairs()
    picked = [pair((100, 120), (300, 220)), pair((150, 80), (2, 2))]
    assert tracked.advance(first, []) == []
    assert tracked.advance(first, picked) == picked
    followed = tracked.advance(second, [pair((1, 1), (2, 2))])  # later ones do not count
    np.testing.assert_allclose(followed[0].nodes, [(95, 117), (295, 217)], atol=0.3)
    assert len(tracked.advance(np.zeros_like(first), picked)) == 0  # what is lost does not come back
    assert tracked.advance(second, picked) == []
