"""Bins of colors, and their histograms."""

import numpy as np

from geoskill.tracking.color_bins import BINS, color_bins, color_histogram


def test_every_color_has_a_bin_of_its_own_place() -> None:
    low, high = np.float32([[0, -128, -128]]), np.float32([[100, 128, 128]])
    assert color_bins(low).tolist() == [0]
    assert color_bins(high).tolist() == [np.prod(BINS) - 1], "the upper bound belongs to the last bin"
    middle = color_bins(np.float32([[50.1, 0.1, 0.1]]))
    assert np.unravel_index(middle[0], BINS) == (6, 16, 16)
    assert color_bins(np.zeros((2, 3, 3), np.float32)).shape == (2, 3)


def test_histograms_are_shares_and_smooth() -> None:
    bins = np.full(20, np.ravel_multi_index((6, 16, 16), BINS), np.uint16)
    shares = color_histogram(bins).reshape(BINS)
    assert abs(shares.sum() - 1) < 1e-12
    assert shares.argmax() == bins[0]
    assert 0 < shares[6, 16, 17] < shares[6, 16, 16]
    none = color_histogram(bins[:0])
    assert (none == none[0]).all()
    assert abs(none.sum() - 1) < 1e-12
