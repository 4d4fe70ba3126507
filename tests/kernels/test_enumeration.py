import math
from itertools import combinations, product

import pytest
import torch

from geoskill.kernels.enumeration import all_pairs, unordered_pairs


@pytest.mark.parametrize("count", [0, 1, 2, 5, 60])
def test_unordered_pairs(count: int) -> None:
    pairs = unordered_pairs(count)
    assert pairs.dtype == torch.long
    assert pairs.shape == (2, math.comb(count, 2))
    assert [tuple(pair) for pair in pairs.T.tolist()] == list(combinations(range(count), 2))


@pytest.mark.parametrize("first", [0, 1, 2, 5])
@pytest.mark.parametrize("second", [0, 1, 2, 5])
def test_all_pairs(first: int, second: int) -> None:
    pairs = all_pairs(first, second)
    assert pairs.dtype == torch.long
    assert pairs.shape == (2, first * second)
    assert [tuple(pair) for pair in pairs.T.tolist()] == list(product(range(first), range(second)))
