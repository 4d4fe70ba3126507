"""Ellipses in drawn pictures: rims, discs, arcs, and what is none."""

import cv2
import numpy as np
import pytest
import torch

from geoskill.features.conics import Conics
from geoskill.geometry.ellipses import ellipse_of_axes, point_to_ellipse, semi_axes
from geoskill.testing import check_extractor


def drawn(*ellipses: tuple[tuple[float, float], tuple[float, float], float], thickness: int = -1) -> np.ndarray:
    """A gray picture with ellipses by center, semi-axes and angle in degrees, drawn four times as fine."""
    picture = np.full((960, 1280), 90, np.uint8)
    for (x, y), (first, second), degrees in ellipses:
        center = (round(4 * x + 1.5), round(4 * y + 1.5))
        cv2.ellipse(picture, center, (round(4 * first), round(4 * second)), degrees, 0, 360, 220, thickness)
    return np.asarray(cv2.resize(picture, (320, 240), interpolation=cv2.INTER_AREA))


def test_ellipse_is_found_where_it_is() -> None:
    (found,) = Conics().extract(drawn(((150, 110), (60, 30), 25))).geometry
    expected = torch.from_numpy(ellipse_of_axes((150.0, 110.0), (60.0, 30.0), np.radians(25)))
    np.testing.assert_allclose(found.reshape(4, 2).mean(axis=0), [150, 110], atol=0.5)
    np.testing.assert_allclose(semi_axes(torch.from_numpy(found)[None])[0], [60, 30], atol=0.7)
    ends = torch.from_numpy(found.reshape(4, 2)).double()
    assert point_to_ellipse(ends, expected.repeat(4, 1)).abs().max() < 0.8


def test_largest_comes_first_and_both_sides_of_a_line_are_one() -> None:
    picture = drawn(((90, 120), (50, 35), 0), ((230, 120), (20, 20), 0), thickness=8)
    centers = Conics().extract(picture).geometry.reshape(-1, 4, 2).mean(axis=1)
    np.testing.assert_allclose(centers, [[90, 120], [230, 120]], atol=0.7)


def test_part_of_a_rim_is_enough_when_it_is_most_of_it() -> None:
    picture = drawn(((150, 120), (60, 40), 0))
    for covered, count in ((110, 1), (170, 0)):
        hidden = picture.copy()
        hidden[:, :covered] = hidden[:, covered : covered + 1]  # no edge along the border of what hides it
        hidden[:, :covered] = 90
        found = Conics().extract(hidden)
        assert len(found) == count


@pytest.mark.parametrize("corners", [3, 4, 5])
def test_polygons_are_none(corners: int) -> None:
    angles = np.arange(corners) * 2 * np.pi / corners
    outline = np.stack([160 + 60 * np.cos(angles), 120 + 60 * np.sin(angles)], axis=1).round().astype(np.int32)
    picture = np.full((240, 320), 90, np.uint8)
    cv2.fillPoly(picture, [outline], 220)
    assert len(Conics().extract(picture)) == 0


def test_descriptor_knows_what_is_inside() -> None:
    plain = drawn(((100, 120), (40, 40), 0), ((220, 120), (40, 40), 0))
    marked = plain.copy()
    marked[110:130, 210:230] = 20
    first, second = Conics().extract(marked).descriptors
    same, other = Conics().extract(plain).descriptors
    assert first @ second < 0.9 < same @ other


def test_conics_keep_the_contract_of_extractors() -> None:
    check_extractor(Conics)
