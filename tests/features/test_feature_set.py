"""Validation and selection of feature sets."""

import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType


def feature_set(count: int = 3, **changes: np.ndarray) -> FeatureSet:
    arrays = {
        "descriptors": np.eye(count, 5, dtype=np.float32),
        "geometry": np.arange(2 * count, dtype=np.float32).reshape(count, 2),
        "scores": np.arange(count, 0, -1).astype(np.float32),
        "orientation_px": np.ones((count, 2), np.float32),
    }
    return FeatureSet(NodeType.POINT, **(arrays | changes))


def test_take_selects_the_rows_of_all_arrays() -> None:
    taken = feature_set().take([0, 2])
    assert taken.scores.tolist() == [3, 1]
    assert taken.geometry.tolist() == [[0, 1], [4, 5]]
    assert taken.descriptors.argmax(axis=1).tolist() == [0, 2]
    assert taken.orientation_px is not None
    assert taken.orientation_px.shape == (2, 2)


@pytest.mark.parametrize("node_type", list(NodeType))
def test_empty_has_the_widths_of_other_sets(node_type: NodeType) -> None:
    empty = FeatureSet.empty(node_type, 7)
    assert (len(empty), empty.descriptors.shape, empty.geometry.shape) == (0, (0, 7), (0, node_type.geometry_dim))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"descriptors": np.eye(2, 5, dtype=np.float32)}, r"\(2, 3, 3\) rows; expected the same number"),
        ({"orientation_px": np.ones((2, 2), np.float32)}, r"orientation_px has shape \(2, 2\); expected \[3, 2\]"),
        ({"geometry": np.zeros((3, 4), np.float32)}, r"geometry has shape \(3, 4\); expected \[n, 2\] for point"),
        ({"scores": np.array([3, np.nan, 1], np.float32)}, "scores of a point feature set holds a number that is not"),
        ({"scores": np.array([1, 2, 3], np.float32)}, "not sorted; expected the highest score first"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_inconsistent_arrays_are_refused(changes: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        feature_set(**changes)
