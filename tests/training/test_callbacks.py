"""The table of curves, and a checkpoint from which training goes on exactly as it would have."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final
from unittest.mock import Mock

import pytest
import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import EarlyStopping
from torch import Tensor, nn

from geoskill.training.callbacks import MetricsTable, ResumableCheckpoint

# A `Training` is what the fixtures of conftest.py make; see there.
Training = Any


def flat(module: nn.Module) -> Tensor:
    return nn.utils.parameters_to_vector(module.parameters()).detach().clone()


@final
@dataclass(frozen=True, eq=False)
class Whole:
    """Four epochs at once."""

    folder: Path
    table: MetricsTable
    weights: Tensor


@pytest.fixture(scope="module")
def whole(training: Training, tmp_path_factory: pytest.TempPathFactory) -> Whole:
    folder = tmp_path_factory.mktemp("whole")
    module = training.module()
    table = training.run(module, folder, epochs=4)
    assert len(table.rows) == 12
    return Whole(folder, table, flat(module))


@final
class InterruptAt(Callback):
    """Ctrl-C at the end of a step."""

    def __init__(self, step: int) -> None:
        self.step = step

    def on_train_batch_end(self, trainer: Trainer, *args: Any) -> None:
        if trainer.global_step == self.step:
            raise KeyboardInterrupt


@pytest.mark.slow
def test_resumed_run_equals_the_unbroken_run(training: Training, whole: Whole, tmp_path: Path) -> None:
    training.run(training.module(), tmp_path / "first", epochs=2)
    module = training.module()
    table = training.run(module, tmp_path / "second", epochs=4, resume=tmp_path / "first" / "skill.ckpt")
    assert table.rows == whole.table.rows
    assert torch.equal(flat(module), whole.weights)
    assert (tmp_path / "second" / "metrics.csv").read_text() == (whole.folder / "metrics.csv").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("step", [7, 9])
def test_resume_after_an_interruption_in_the_third_epoch(
    training: Training, whole: Whole, tmp_path: Path, interrupts: None, step: int
) -> None:
    with pytest.raises(SystemExit):
        training.run(training.module(), tmp_path / "first", epochs=4, callbacks=[InterruptAt(step)])
    stored = torch.load(tmp_path / "first" / "skill.ckpt", weights_only=True)
    assert (stored["epoch"], stored["global_step"]) == (1, 6)
    assert len((tmp_path / "first" / "metrics.csv").read_text().splitlines()) == 1 + 6
    module = training.module()
    table = training.run(module, tmp_path / "second", epochs=4, resume=tmp_path / "first" / "skill.ckpt")
    assert table.rows == whole.table.rows
    assert torch.equal(flat(module), whole.weights)


@pytest.mark.slow
def test_resume_after_an_interruption_in_the_first_epoch(
    training: Training, whole: Whole, tmp_path: Path, interrupts: None
) -> None:
    with pytest.raises(SystemExit):
        training.run(training.module(), tmp_path / "first", epochs=4, callbacks=[InterruptAt(2)])
    assert not (tmp_path / "first" / "metrics.csv").exists()
    members = training.members()
    with torch.no_grad():
        for member in members.values():
            for parameter in member.parameters():
                parameter.add_(1)  # whatever they start from, the checkpoint rules
    module = training.module(members)
    table = training.run(module, tmp_path / "second", epochs=4, resume=tmp_path / "first" / "skill.ckpt")
    assert table.rows == whole.table.rows
    assert torch.equal(flat(module), whole.weights)


@pytest.mark.slow
def test_resume_after_two_interruptions(training: Training, whole: Whole, tmp_path: Path, interrupts: None) -> None:
    """The second time right after it went on, in the same folder as the first."""
    for resume, step in ((None, 7), (tmp_path / "run" / "skill.ckpt", 7), (tmp_path / "run" / "skill.ckpt", 11)):
        with pytest.raises(SystemExit):
            training.run(training.module(), tmp_path / "run", epochs=4, resume=resume, callbacks=[InterruptAt(step)])
    module = training.module()
    table = training.run(module, tmp_path / "run", epochs=4, resume=tmp_path / "run" / "skill.ckpt")
    assert table.rows == whole.table.rows
    assert torch.equal(flat(module), whole.weights)


@pytest.mark.slow
def test_resume_of_a_complete_run_changes_nothing(training: Training, whole: Whole, tmp_path: Path) -> None:
    module = training.module()
    table = training.run(module, tmp_path / "again", epochs=4, resume=whole.folder / "skill.ckpt")
    assert table.rows == whole.table.rows
    assert torch.equal(flat(module), whole.weights)


@pytest.mark.slow
def test_early_stopping_goes_on_counting_after_resume(training: Training, tmp_path: Path) -> None:
    """Without any progress large enough, training stops after the second epoch without one, resumed or not."""

    def stopping() -> EarlyStopping:
        return EarlyStopping("objective_epoch", mode="max", patience=2, min_delta=10.0)

    at_once = training.run(training.module(), tmp_path / "whole", epochs=9, callbacks=[stopping()])
    assert [row["epoch"] for row in at_once.rows[::3]] == [0, 1, 2]
    training.run(training.module(), tmp_path / "first", epochs=2, callbacks=[stopping()])
    resumed = training.run(
        training.module(),
        tmp_path / "second",
        epochs=9,
        resume=tmp_path / "first" / "skill.ckpt",
        callbacks=[stopping()],
    )
    assert resumed.rows == at_once.rows


def test_metrics_table_has_a_row_for_each_step_and_a_column_for_each_metric(whole: Whole) -> None:
    with (whole.folder / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["step"], row["epoch"]) for row in rows] == [(str(i + 1), str(i // 3)) for i in range(12)]
    quantities = ("objective", "reward", "rsw", "goal", "error")
    figures = {f"{name}/{quantity}" for name in ("p2p_sift", "p2l_sift_lbd") for quantity in quantities}
    assert set(rows[0]) == {"step", "epoch"} | figures
    for row, kept in zip(rows, whole.table.rows, strict=True):
        assert {name: float(value) for name, value in row.items()} == kept
        for name in ("p2p_sift", "p2l_sift_lbd"):
            assert -1 <= kept[f"{name}/reward"] <= 1
            assert 0 <= kept[f"{name}/rsw"] <= 1
            assert kept[f"{name}/goal"] > 0
    assert sorted(path.name for path in whole.folder.iterdir()) == ["metrics.csv", "skill.ckpt"]


def test_metrics_table_state_holds_the_rows(tmp_path: Path) -> None:
    first, second = MetricsTable(tmp_path / "a.csv"), MetricsTable(tmp_path / "b.csv")
    first.rows.append({"step": 1, "p2p_sift/reward": 0.25})
    state = first.state_dict()
    second.load_state_dict(state)
    second.rows.append({"step": 2, "p2p_sift/reward": 0.5})
    assert first.rows == state["rows"] == [{"step": 1, "p2p_sift/reward": 0.25}]
    assert [row["step"] for row in second.rows] == [1, 2]


@pytest.mark.parametrize("rank", [0, 1])
def test_metrics_table_is_written_by_the_first_process_only(tmp_path: Path, rank: int) -> None:
    table = MetricsTable(tmp_path / "metrics.csv")
    trainer = Mock(
        spec=Trainer,
        is_global_zero=rank == 0,
        global_step=1,
        current_epoch=0,
        logged_metrics={"p2p_sift/reward": torch.tensor(0.25), "objective_step": torch.tensor(0.5)},
    )
    module = Mock(spec=LightningModule)
    table.on_train_epoch_end(trainer, module)
    assert not table.path.exists()  # there is nothing to write yet
    table.on_train_batch_end(trainer, module, None, None, 0)
    assert table.rows == [{"step": 1, "epoch": 0, "p2p_sift/reward": 0.25}]
    table.on_train_epoch_end(trainer, module)
    assert table.path.exists() == (rank == 0)
    if rank == 0:
        assert table.path.read_text().split() == ["step,epoch,p2p_sift/reward", "1,0,0.25"]


def test_resumable_checkpoint_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "skill.ckpt"
    path.write_bytes(b"old")

    def save_checkpoint(target: Path) -> None:
        target.write_bytes(b"half of the ne")
        raise OSError(28, "No space left on device")

    trainer = Mock(spec=Trainer, is_global_zero=True, save_checkpoint=save_checkpoint)
    with pytest.raises(OSError, match="No space left"):
        ResumableCheckpoint(path).on_train_epoch_end(trainer, Mock(spec=LightningModule))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
