"""Learning: each member by itself, repeatable, with every objective and precision."""

from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geoskill.skill.checkpoint import read_skill
from geoskill.skill.skill import Skill
from geoskill.training.callbacks import MetricsTable

# A `Training` is what the fixtures of conftest.py make; see there.
Training = Any

P2P, P2L = "p2p_sift", "p2l_sift_lbd"
BILINEAR = {"name": "bilinear", "hidden_dim": 8}


def flat(module: nn.Module) -> Tensor:
    return nn.utils.parameters_to_vector(module.parameters()).detach().clone()


def column(table: MetricsTable, name: str) -> np.ndarray:
    return np.array([row[name] for row in table.rows])


@pytest.mark.slow
def test_training_learns_to_join_the_moving_tile_with_its_target(
    training_of: Callable[..., Training], demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    training = training_of(P2P)
    module = training.module(optimizer=partial(torch.optim.Adam, lr=1e-2), feature_dropout=0.0)
    table = training.run(module, tmp_path, epochs=12, batch_size=8)
    objective, reward, rsw = (column(table, f"{P2P}/{name}") for name in ("objective", "reward", "rsw"))
    # It learns within a few steps, so the first one alone is what it starts from.
    assert objective[-6:].mean() > objective[0] + 0.2
    assert reward[-6:].mean() > 0.6 > reward[0]
    assert rsw[-6:].mean() < 0.3 < rsw[0]

    skill = Skill.load(tmp_path / "skill.ckpt")
    right = 0
    for number, frame in enumerate(demonstration_frames):
        (xa, ya), (xb, yb) = sorted(node.coordinates for node in skill.infer(frame).associations[0].nodes)
        moving = 26 < xa - 2.5 * number < 62 and 44 < ya < 80
        right += moving and xb > 106 and 44 < yb < 80
    assert right >= 17  # of 20; about a third of all instances join the two tiles


@pytest.mark.slow
def test_ensemble_learns_what_its_members_learn_alone(
    training: Training, training_of: Callable[..., Training], tmp_path: Path
) -> None:
    together = training.module()
    before = {name: flat(member) for name, member in together.members.items()}
    both = training.run(together, tmp_path / "both", epochs=2)
    for name in (P2P, P2L):
        alone = training_of(name)
        module = alone.module()
        table = alone.run(module, tmp_path / name, epochs=2)
        assert torch.equal(flat(module.members[name]), flat(together.members[name]))
        assert not torch.allclose(flat(module.members[name]), before[name], atol=1e-3)
        for quantity in ("objective", "reward", "rsw", "goal", "error"):
            assert np.array_equal(column(table, f"{name}/{quantity}"), column(both, f"{name}/{quantity}"))


def test_noise_differs_between_members_steps_and_processes(training: Training, monkeypatch: pytest.MonkeyPatch) -> None:
    module = training.module()
    place = {"step": 0, "rank": 0}
    monkeypatch.setattr(type(module), "global_step", property(lambda self: place["step"]))
    monkeypatch.setattr(type(module), "global_rank", property(lambda self: place["rank"]))
    drawn = []
    for module.seed, place["step"], place["rank"], name in product((5, 6), range(3), range(2), (P2P, P2L)):
        drawn.append(torch.randn(4, generator=module._generator(name)))
        assert torch.equal(drawn[-1], torch.randn(4, generator=module._generator(name)))
    assert len({tuple(numbers.tolist()) for numbers in drawn}) == 2 * 3 * 2 * 2


@pytest.mark.slow
def test_noise_and_dropout_change_what_is_learned_but_not_from_run_to_run(training: Training, tmp_path: Path) -> None:
    learned = []
    for number, (noise, dropout) in enumerate(((0.3, 0.2), (0.3, 0.2), (0.0, 0.2), (0.3, 0.0))):
        module = training.module(descriptor_noise=noise, feature_dropout=dropout)
        training.run(module, tmp_path / str(number), epochs=1)
        learned.append(flat(module))
    assert torch.equal(learned[0], learned[1])
    for other in learned[2:]:
        assert not torch.allclose(learned[0], other, atol=1e-4)


def test_gradients_are_clipped_member_by_member(training: Training) -> None:
    module = training.module()
    for name, size in ((P2P, 10.0), (P2L, 0.5)):
        weights = flat(module.members[name]).numel()
        for parameter in module.members[name].parameters():
            parameter.grad = torch.full_like(parameter, size / weights**0.5)
        assert gradient_norm(module.members[name]) == pytest.approx(size, rel=1e-4)
    module.configure_gradient_clipping(module.configure_optimizers(), 1.0)
    assert gradient_norm(module.members[P2P]) == pytest.approx(1.0, rel=1e-4)
    assert gradient_norm(module.members[P2L]) == pytest.approx(0.5, rel=1e-4)
    module.configure_gradient_clipping(module.configure_optimizers(), None)
    assert gradient_norm(module.members[P2P]) == pytest.approx(1.0, rel=1e-4)


def gradient_norm(module: nn.Module) -> float:
    return float(torch.cat([p.grad.flatten() for p in module.parameters() if p.grad is not None]).norm())


@pytest.mark.slow
@pytest.mark.parametrize(("algorithm", "limit", "order"), [("norm", 1e-3, 2), ("value", 1e-5, float("inf"))])
def test_gradients_are_clipped_by_norm_or_by_value(
    training: Training, tmp_path: Path, algorithm: str, limit: float, order: float
) -> None:
    """Plain descent of rate 1 moves the weights by the clipped gradient."""
    module = training.module(optimizer=partial(torch.optim.SGD, lr=1.0))
    before = {name: flat(member) for name, member in module.members.items()}
    training.run(
        module,
        tmp_path,
        epochs=1,
        limit_train_batches=1,
        gradient_clip_val=limit,
        gradient_clip_algorithm=algorithm,
    )
    for name, member in module.members.items():
        assert float((flat(member) - before[name]).norm(order)) == pytest.approx(limit, rel=1e-2)


def test_reward_scale_is_part_of_the_checkpoint(training: Training, tmp_path: Path) -> None:
    module = training.module()
    training.run(module, tmp_path, epochs=1)
    skill = Skill.load(tmp_path / "skill.ckpt")
    for name, member in module.members.items():
        assert skill.members[name].spans.tolist() == [2, 4, 8]
        assert torch.equal(skill.members[name].beta, member.beta)
        assert (member.beta > 0).all()


def test_checkpoint_holds_plain_types_only(training: Training, tmp_path: Path) -> None:
    training.run(training.module(), tmp_path, epochs=1)
    checkpoint = torch.load(tmp_path / "skill.ckpt", weights_only=True)
    strange = set(types_within(checkpoint)) - {dict, list, tuple, str, int, float, bool, type(None), Tensor}
    # `state_dict()` of PyTorch gives an OrderedDict.
    assert {kind.__name__ for kind in strange} <= {"OrderedDict"}
    assert read_skill(tmp_path / "skill.ckpt").spec == training.spec
    assert "hyper_parameters" not in checkpoint


def types_within(value: Any) -> list[type]:
    if isinstance(value, dict):
        return [type(value), *(kind for pair in value.items() for part in pair for kind in types_within(part))]
    if isinstance(value, list | tuple):
        return [type(value), *(kind for part in value for kind in types_within(part))]
    return [type(value)]


VARIANTS: dict[str, dict[str, Any]] = {
    "as usual": {},
    "Monte Carlo": {"partition": "monte_carlo", "value_samples": 50, "gradient_samples": 50},
    "the paper's reward": {"reward": "frame", "change": "absolute", "error_reduction": "vector"},
    "absolute change": {"change": "absolute"},
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variant", "model", "precision"),
    [
        ("as usual", "message passing", "bf16-mixed"),
        ("as usual", "bilinear", "32-true"),
        ("Monte Carlo", "message passing", "32-true"),
        ("the paper's reward", "message passing", "32-true"),
        ("the paper's reward", "bilinear", "bf16-mixed"),
        ("absolute change", "message passing", "32-true"),
    ],
)
def test_every_variant_trains(training: Training, tmp_path: Path, variant: str, model: str, precision: str) -> None:
    members = training.members(BILINEAR) if model == "bilinear" else training.members()
    module = training.module(members, **VARIANTS[variant])
    before = {name: flat(member) for name, member in module.members.items()}
    table = training.run(module, tmp_path, epochs=1, precision=precision, check_types=True)
    assert len(table.rows) == 3
    assert all(np.isfinite(list(row.values())).all() for row in table.rows)
    for name, member in module.members.items():
        assert torch.isfinite(flat(member)).all()
        assert (flat(member) - before[name]).abs().max() > 1e-3
        assert {parameter.dtype for parameter in member.parameters()} == {torch.float32}


@pytest.mark.slow
def test_bfloat16_is_close_to_float32(training: Training, tmp_path: Path) -> None:
    full, mixed = (
        training.run(training.module(), tmp_path / precision, epochs=1, precision=precision)
        for precision in ("32-true", "bf16-mixed")
    )
    for name in (P2P, P2L):
        exact, rounded = (column(table, f"{name}/objective") for table in (full, mixed))
        assert not np.array_equal(exact, rounded)
        np.testing.assert_allclose(rounded, exact, rtol=0, atol=5e-3)


@pytest.mark.slow
def test_monte_carlo_samples_are_repeatable(training: Training, tmp_path: Path) -> None:
    learned = []
    for number in range(2):
        torch.manual_seed(number)
        module = training.module(**VARIANTS["Monte Carlo"])
        training.run(module, tmp_path / str(number), epochs=1)
        learned.append(flat(module))
    assert torch.equal(*learned)


def test_frames_without_features_do_no_harm(
    training: Training, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    frames = list(demonstration_frames[:10])
    for number in (0, 3, 9):
        frames[number] = np.full_like(frames[number], 128)
    gappy = type(training)(frames, training.spec)
    module = gappy.module()
    table = gappy.run(module, tmp_path, epochs=2, limit_train_batches=1.0)
    assert all(np.isfinite(list(row.values())).all() for row in table.rows)
    assert torch.isfinite(flat(module)).all()


def test_limit_train_batches_bounds_an_epoch(training: Training, tmp_path: Path) -> None:
    table = training.run(training.module(), tmp_path, epochs=2, limit_train_batches=2)
    assert [(row["step"], row["epoch"]) for row in table.rows] == [(1, 0), (2, 0), (3, 1), (4, 1)]
