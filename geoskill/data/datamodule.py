"""Batches of transitions for Lightning."""

from typing import final

from lightning import LightningDataModule
from torch.utils.data import DistributedSampler
from torch_geometric.loader import DataLoader

from geoskill.data.transitions import Transition, Transitions
from geoskill.errors import InputError


@final
class TransitionData(LightningDataModule):
    """Shuffled mini-batches of transitions, in an order that depends on seed and epoch only.

    Args:
        demonstration: the transitions.
        batch_size: transitions per step; 1 is the paper's Algorithm 1.
        seed: of the order.

    Raises:
        InputError: when ``batch_size`` is below 1.
    """

    def __init__(self, demonstration: Transitions, *, batch_size: int, seed: int) -> None:
        super().__init__()
        if batch_size < 1:
            raise InputError(f"batch_size={batch_size}: expected at least 1")
        self.demonstration = demonstration
        self.batch_size = batch_size
        self.seed = seed

    def train_dataloader(self) -> DataLoader:
        """Return the batches of an epoch.

        Lightning tells the sampler the number of the epoch, so that a resumed training sees the same order.
        """
        replicas, rank = (self.trainer.world_size, self.trainer.global_rank) if self.trainer else (1, 0)
        sampler: DistributedSampler[Transition] = DistributedSampler(
            self.demonstration, replicas, rank, shuffle=True, seed=self.seed
        )
        return DataLoader(self.demonstration, batch_size=self.batch_size, sampler=sampler)
