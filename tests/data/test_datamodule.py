"""Batches of transitions: complete, in a repeatable random order, and shared among processes."""

from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from geoskill.data.datamodule import TransitionData
from geoskill.data.demonstration import Demonstration
from geoskill.errors import InputError


def data(demonstration: Demonstration, seed: int = 0, batch_size: int = 8, processes: int = 1, rank: int = 0) -> Any:
    module = TransitionData(demonstration, batch_size=batch_size, seed=seed)
    if processes > 1:
        trainer: Any = SimpleNamespace(world_size=processes, global_rank=rank)
        module.trainer = trainer
    return module


def order(module: TransitionData, epoch: int = 0) -> list[int]:
    """The numbers of the transitions in an epoch."""
    loader = module.train_dataloader()
    loader.sampler.set_epoch(epoch)
    return list(loader.sampler)


def test_epoch_has_every_transition_once(demonstration: Demonstration) -> None:
    indices = order(data(demonstration))
    assert sorted(indices) == list(range(46))
    assert indices != sorted(indices)


def test_order_depends_on_seed_and_epoch_only(demonstration: Demonstration) -> None:
    first = order(data(demonstration, seed=3), epoch=2)
    torch.manual_seed(77)
    assert order(data(demonstration, seed=3), epoch=2) == first
    assert order(data(demonstration, seed=3), epoch=1) != first
    assert order(data(demonstration, seed=4), epoch=2) != first


def test_batches_hold_the_transitions_in_order(demonstration: Demonstration) -> None:
    module = data(demonstration, batch_size=20)
    batches = list(module.train_dataloader())
    assert [batch["p2p_sift"]["first"].num_graphs for batch in batches] == [20, 20, 6]
    expected = [demonstration[index] for index in order(module)]
    for which in ("first", "second"):
        for name in ("p2p_sift", "p2l_sift_lbd"):
            for key in ("span_index", "point_next_geometry", "point_count"):
                together = torch.cat([batch[name][which][key] for batch in batches])
                assert torch.equal(together, torch.cat([transition[name][which][key] for transition in expected]))


@pytest.mark.parametrize("processes", [2, 3])
def test_processes_share_all_transitions(demonstration: Demonstration, processes: int) -> None:
    shares = [order(data(demonstration, seed=1, processes=processes, rank=rank), epoch=4) for rank in range(processes)]
    assert len({len(share) for share in shares}) == 1
    counts = Counter(index for share in shares for index in share)
    assert set(counts) == set(range(46))
    # 46 are not three equal shares: two transitions come twice, so that no process waits for another.
    assert sum(counts.values()) - 46 == (-46) % processes


@pytest.mark.parametrize("batch_size", [0, -1])
def test_transition_data_rejects_batch_size_below_one(demonstration: Demonstration, batch_size: int) -> None:
    with pytest.raises(InputError, match=rf"^batch_size={batch_size}: expected at least 1$"):
        TransitionData(demonstration, batch_size=batch_size, seed=0)
