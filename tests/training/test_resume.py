"""Going on with a training, exactly as it would have gone on; and starting from a skill's network."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest
import torch
from lightning.pytorch.loggers import Logger

from geoskill.config import (
    EarlyStoppingConfig,
    ObjectiveConfig,
    OptimizerConfig,
    ScenarioConfig,
    TrainConfig,
    TrainerConfig,
)
from geoskill.errors import InputError
from geoskill.skill.checkpoint import SimulatedScene, StoredSkill, read_skill
from geoskill.skill.skill import Skill
from geoskill.training.learn import LearnedSkill, TrainingInterruptedError

# What the fixtures of conftest.py make; see there.
Learn = Any
Configured = Callable[..., TrainConfig]
StateOf = Callable[[Skill], dict[str, torch.Tensor]]

EPOCHS = 3
STEPS = 3
"""Steps of an epoch."""


@final
@dataclass
class Observer(Logger):
    """A logger that reads the checkpoint at every step, and presses Ctrl-C at one of them.

    Attributes:
        checkpoint: the file.
        interrupt_at: number of the step, from 0, or None.
        seen: the checkpoints as they were.
    """

    checkpoint: Path
    interrupt_at: int | None = None
    seen: list[StoredSkill] = field(default_factory=list)
    hyperparameters: Any = None

    @property
    def name(self) -> str:
        return "observer"

    @property
    def version(self) -> int:
        return 0

    def log_metrics(self, metrics: Mapping[str, float], step: int | None = None) -> None:
        self.seen.append(read_skill(self.checkpoint))
        if self.interrupt_at is not None and step is not None and step >= self.interrupt_at:
            raise KeyboardInterrupt

    def log_hyperparams(self, params: Any, *args: Any, **kwargs: Any) -> None:
        self.hyperparameters = params


@pytest.fixture(scope="module", params=[0.9, None], ids=["averaged", "last weights"])
def config(request: pytest.FixtureRequest, configured: Configured) -> TrainConfig:
    return configured(EPOCHS, kernel=["p2p", "p2l"], ema_decay=request.param)


@final
@dataclass(frozen=True, eq=False)
class Unbroken:
    """All epochs at once."""

    folder: Path
    learned: LearnedSkill
    seen: list[StoredSkill]


@pytest.fixture(scope="module")
def unbroken(
    learn_unchecked: Learn, config: TrainConfig, pictures: np.ndarray, tmp_path_factory: pytest.TempPathFactory
) -> Unbroken:
    folder = tmp_path_factory.mktemp("unbroken")
    observer = Observer(folder / "skill.ckpt")
    learned = learn_unchecked(
        config, pictures, checkpoint=folder / "skill.ckpt", curves=folder / "metrics.csv", logger=observer
    )
    return Unbroken(folder, learned, observer.seen)


@pytest.fixture
def same(state_of: StateOf) -> Callable[[LearnedSkill, LearnedSkill], None]:
    """Return a function that asserts that weights, statistics, margins, curves and metrics are equal bit by bit."""

    def compare(learned: LearnedSkill, expected: LearnedSkill) -> None:
        state, expected_state = state_of(learned.skill), state_of(expected.skill)
        assert list(state) == list(expected_state)
        for name, value in state.items():
            assert torch.equal(value, expected_state[name]), name
        assert list(learned.curves) == list(expected.curves)
        assert learned.metrics == expected.metrics
        when = expected.skill.provenance.date
        assert replace(learned.skill.provenance, date=when, configuration={}) == replace(
            expected.skill.provenance, configuration={}
        )

    return compare


Same = Callable[[LearnedSkill, LearnedSkill], None]


def margins(stored: StoredSkill) -> list[float]:
    return [float(weights["reference_margin"]) for weights in stored.weights.values()]


def interrupted(
    learn_unchecked: Learn, config: TrainConfig, pictures: np.ndarray, path: Path, step: int, **options: Any
) -> int:
    """Interrupt a training at a step and return the number of epochs that are in its checkpoint."""
    observer = Observer(path, interrupt_at=step)
    with pytest.raises(TrainingInterruptedError) as caught:
        learn_unchecked(config, pictures, checkpoint=path, logger=observer, **options)
    return caught.value.epochs


@pytest.mark.slow
@pytest.mark.parametrize("step", [1, 3, 4, 7])
def test_resumed_training_equals_the_unbroken_one(
    learn_unchecked: Learn,
    config: TrainConfig,
    unbroken: Unbroken,
    pictures: np.ndarray,
    tmp_path: Path,
    interrupts: None,
    same: Same,
    step: int,
) -> None:
    epochs = interrupted(learn_unchecked, config, pictures, tmp_path / "skill.ckpt", step)
    stored = read_skill(tmp_path)
    assert epochs == stored.provenance.epochs[0] == step // STEPS
    assert not stored.provenance.finished
    learned = learn_unchecked(
        config,
        pictures,
        resume=tmp_path,
        checkpoint=tmp_path / "skill.ckpt",
        curves=tmp_path / "metrics.csv",
    )
    same(learned, unbroken.learned)
    assert (tmp_path / "metrics.csv").read_text() == (unbroken.folder / "metrics.csv").read_text()
    state, expected = (read_skill(folder).contents["state_dict"] for folder in (tmp_path, unbroken.folder))
    assert all(torch.equal(value, expected[name]) for name, value in state.items())


@pytest.mark.slow
def test_training_that_is_interrupted_twice_equals_the_unbroken_one(
    learn_unchecked: Learn,
    config: TrainConfig,
    unbroken: Unbroken,
    pictures: np.ndarray,
    tmp_path: Path,
    interrupts: None,
    same: Same,
) -> None:
    path = tmp_path / "skill.ckpt"
    assert interrupted(learn_unchecked, config, pictures, path, 4) == 1
    assert interrupted(learn_unchecked, config, pictures, path, 7, resume=path) == 2
    same(learn_unchecked(config, pictures, resume=path), unbroken.learned)


def assert_only_last_is_finished(seen: list[StoredSkill], epochs: list[int]) -> None:
    """Check the checkpoints that a training wrote; the last one, too, is seen by a logger."""
    done = [stored.provenance.epochs[0] for stored in seen]
    assert list(dict.fromkeys(done)) == epochs
    for stored, number in zip(seen, done, strict=True):
        assert stored.provenance.finished == (number == epochs[-1])
        assert all((margin > 0) == stored.provenance.finished for margin in margins(stored))


@pytest.mark.slow
def test_only_the_last_checkpoint_is_finished(unbroken: Unbroken) -> None:
    assert_only_last_is_finished(unbroken.seen, [0, 1, 2, 3])
    assert {stored.provenance.epochs[1] for stored in unbroken.seen} == {EPOCHS}


def test_metrics_of_a_checkpoint_are_those_of_its_epoch(unbroken: Unbroken) -> None:
    by_epoch = {stored.provenance.epochs[0]: dict(stored.provenance.metrics) for stored in unbroken.seen}
    assert by_epoch[0] == {}
    for epoch in (1, 2):
        rows = [row for row in unbroken.learned.curves if row["epoch"] == epoch - 1]
        means = [np.mean([row[f"{name}/rsw"] for row in rows]) for name in unbroken.learned.skill.members]
        assert by_epoch[epoch]["rsw"] == pytest.approx(np.mean(means), rel=1e-5)


@pytest.mark.slow
def test_checkpoint_with_all_epochs_is_finished_by_calibration(
    learn_unchecked: Learn,
    config: TrainConfig,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    interrupts: None,
    same: Same,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A training of three epochs is interrupted after two and then asked for no more than these."""
    interrupted(learn_unchecked, config, pictures, tmp_path / "skill.ckpt", 7)
    shorter = configured(2, kernel=["p2p", "p2l"], ema_decay=config.ema_decay)
    expected = learn_unchecked(shorter, pictures, checkpoint=tmp_path / "expected.ckpt", curves=tmp_path / "b.csv")
    with monkeypatch.context() as patch:
        patch.setattr("geoskill.training.learn.build_trainer", None)  # nothing is trained
        learned = learn_unchecked(
            shorter, pictures, resume=tmp_path, checkpoint=tmp_path / "finished.ckpt", curves=tmp_path / "a.csv"
        )
    same(learned, expected)
    assert (tmp_path / "a.csv").read_text() == (tmp_path / "b.csv").read_text()
    written, wanted = read_skill(tmp_path / "finished.ckpt"), read_skill(tmp_path / "expected.ckpt")
    assert (written.provenance.finished, written.provenance.epochs) == (True, (2, 2))
    for name, value in wanted.contents["state_dict"].items():
        assert torch.equal(written.contents["state_dict"][name], value), name
    longer = learn_unchecked(config, pictures, resume=tmp_path / "finished.ckpt")
    same(longer, learn_unchecked(config, pictures, resume=tmp_path / "expected.ckpt"))


def test_resuming_what_is_finished_changes_nothing(
    learn_unchecked: Learn, config: TrainConfig, unbroken: Unbroken, pictures: np.ndarray, tmp_path: Path, same: Same
) -> None:
    learned = learn_unchecked(
        config,
        pictures,
        resume=unbroken.folder,
        checkpoint=tmp_path / "skill.ckpt",
        curves=tmp_path / "metrics.csv",
    )
    same(learned, unbroken.learned)
    assert learned.skill.provenance == unbroken.learned.skill.provenance
    assert (tmp_path / "metrics.csv").read_text() == (unbroken.folder / "metrics.csv").read_text()
    assert read_skill(tmp_path).provenance == read_skill(unbroken.folder).provenance


@pytest.mark.slow
def test_finished_training_goes_on_for_more_epochs(
    learn_unchecked: Learn,
    config: TrainConfig,
    unbroken: Unbroken,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    same: Same,
) -> None:
    shorter = configured(1, kernel=["p2p", "p2l"], ema_decay=config.ema_decay)
    learn_unchecked(shorter, pictures, checkpoint=tmp_path / "skill.ckpt")
    observer = Observer(tmp_path / "skill.ckpt")
    learned = learn_unchecked(config, pictures, resume=tmp_path, checkpoint=tmp_path / "skill.ckpt", logger=observer)
    same(learned, unbroken.learned)
    assert_only_last_is_finished(observer.seen, [1, 2, 3])


@pytest.mark.slow
@pytest.mark.parametrize("ema_decay", [0.9, None])
def test_early_stopping_ends_with_a_finished_checkpoint(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    interrupts: None,
    same: Same,
    state_of: StateOf,
    ema_decay: float | None,
) -> None:
    """Without any progress large enough, training stops after the second epoch."""
    patient = EarlyStoppingConfig(patience=1, min_delta=10.0)
    config = configured(9, ema_decay=ema_decay, early_stopping=patient)
    path = tmp_path / "run" / "skill.ckpt"
    path.parent.mkdir()
    observer = Observer(path)
    learned = learn_unchecked(config, pictures, checkpoint=path, logger=observer)
    assert_only_last_is_finished(observer.seen, [0, 1, 2])
    stored = read_skill(path)
    assert (stored.provenance.finished, stored.provenance.epochs) == (True, (2, 9))
    assert min(margins(stored)) > 0
    for name, value in state_of(learned.skill).items():
        assert torch.equal(value, stored.contents["state_dict"][name]), name
    again = learn_unchecked(config, pictures, resume=path, checkpoint=tmp_path / "again.ckpt")
    same(again, learned)
    assert interrupted(learn_unchecked, config, pictures, tmp_path / "b.ckpt", 4) == 1
    same(learn_unchecked(config, pictures, resume=tmp_path / "b.ckpt"), learned)


def test_logger_gets_the_configuration(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, tmp_path: Path
) -> None:
    observer = Observer(tmp_path / "skill.ckpt")
    learned = learn_unchecked(configured(1), pictures, checkpoint=observer.checkpoint, logger=[observer])
    assert observer.hyperparameters == learned.skill.provenance.configuration


@pytest.fixture(scope="module")
def finished(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Return the checkpoint of one epoch of p2p_sift, with prototypes."""
    path: Path = tmp_path_factory.mktemp("finished") / "skill.ckpt"
    learn_unchecked(configured(1, model=NETWORK), pictures, checkpoint=path)
    return path


NETWORK = {"name": "message_passing", "hidden_dim": 4, "layers": 1, "encoder_dim": None, "prototypes": 6, "cascade": 5}
SCENE = SimulatedScene("sorting", 3, ScenarioConfig())


@pytest.mark.parametrize(
    ("settings", "options", "message"),
    [
        ({"kernel": "p2l"}, {}, "has members p2p_sift; expected p2l_sift_lbd, as in this run$"),
        ({"kernel": ["p2p", "p2l"]}, {}, "has members p2p_sift; expected p2p_sift, p2l_sift_lb"),
        ({"descriptor": "orb"}, {}, "has members p2p_sift; expected p2p_orb, as in this run$"),
        ({"descriptor": {"sift": {"root": True}}}, {}, "has extractors .*'root': False.*; expected .*'root': True"),
        ({"model": {**NETWORK, "hidden_dim": 5}}, {}, "has model .*'hidden_dim': 4.*expected .*'hidden_dim': 5"),
        ({"model": {**NETWORK, "cascade": 7}}, {}, "has model .*'cascade': 5.*expected .*'cascade': 7"),
        (
            {"demonstration": {"gap": 3}},
            {},
            r"was trained with demonstration\.gap=2; expected demonstration\.gap=3, as in",
        ),
        (
            {"optimizer": OptimizerConfig(lr=0.1)},
            {},
            r"was trained with optimizer\.lr=0\.003; expected optimizer\.lr=0\.1, ",
        ),
        (
            {"seed": 7},
            {},
            r"was trained with seed=0; expected seed=7, as in this run \(init_from= starts from its weigh",
        ),
        ({"ema_decay": None}, {}, r"was trained with ema_decay=0\.99; expected ema_decay=null, as in this run"),
        (
            {"objective": ObjectiveConfig(top_k=3, sigma0=2.0, reward="frame")},
            {},
            r"was trained with objective\.sigma0=0\.55, objective\.reward=tracked; expected objective\.sigma0=2\.0, o",
        ),
        (
            {"trainer": TrainerConfig(gradient_clip_val=None)},
            {},
            r"was trained with trainer\.limit_train_batches=3, train",
        ),
        ({}, {"shorter": True}, r"learned from transitions over \[2, 4\] .*, \[2\] \(init_from="),
        ({}, {"scene": SCENE}, r"learned from a video; expected what this run learns from, SimulatedScene\("),
        ({}, {"demonstrations": 2}, r"learned from 1 demonstration\(s\); expected 2, as this run$"),
    ],
)
def test_resuming_another_training_is_refused(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    finished: Path,
    settings: dict[str, Any],
    options: dict[str, Any],
    message: str,
) -> None:
    demonstrations = [pictures[:6] if "shorter" in options else pictures] * options.get("demonstrations", 1)
    options = {name: value for name, value in options.items() if name == "scene"}
    with pytest.raises(InputError, match=f"^{finished}: {message}") as caught:
        learn_unchecked(configured(**{"model": NETWORK, **settings}), demonstrations, resume=finished, **options)
    assert "\n" not in str(caught.value)


def test_resuming_a_skill_without_its_training_is_refused(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, finished: Path, tmp_path: Path
) -> None:
    path = tmp_path / "saved.ckpt"
    Skill.load(finished).save(path)
    message = f"^{path}: holds a skill, but not the state of its training; expected init_from={path}$"
    with pytest.raises(InputError, match=message):
        learn_unchecked(configured(model=NETWORK), pictures, resume=path)


def test_resuming_excludes_starting_from_a_skill(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, finished: Path
) -> None:
    with pytest.raises(InputError, match=rf"^init_from=other\.ckpt: expected none, as the training of {finished} goes"):
        learn_unchecked(configured(model=NETWORK), pictures, resume=finished, init_from="other.ckpt")


def test_missing_checkpoint_is_refused(learn_unchecked: Learn, configured: Configured, pictures: np.ndarray) -> None:
    for key in ("resume", "init_from"):
        with pytest.raises(InputError, match=r"^/no/such\.ckpt: no such file; expected the skill\.ckpt of a training"):
            learn_unchecked(configured(), pictures, **{key: "/no/such.ckpt"})


@pytest.fixture(scope="module")
def elsewhere(demonstration_frames: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return a demonstration with other prototypes, scale and order of nodes: the earliest frames, mirrored."""
    return np.stack(demonstration_frames[:9])[:, :, ::-1].copy()


@pytest.mark.parametrize("saved", [False, True])
def test_init_from_takes_the_network_and_fits_statistics_anew(
    learn_unchecked: Learn,
    configured: Configured,
    elsewhere: np.ndarray,
    finished: Path,
    tmp_path: Path,
    interrupts: None,
    saved: bool,
) -> None:
    reference = finished
    if saved:
        reference = tmp_path / "saved.ckpt"
        Skill.load(finished).save(reference)
    config = configured(1, model=NETWORK)
    first, fresh = tmp_path / "first.ckpt", tmp_path / "fresh.ckpt"
    interrupted(learn_unchecked, config, elsewhere, first, 0, init_from=reference)
    interrupted(learn_unchecked, config, elsewhere, fresh, 0)
    skill, own, without = (read_skill(path).weights["p2p_sift"] for path in (finished, first, fresh))
    for name, value in own.items():
        if name.startswith("scorer."):
            assert torch.equal(value, skill[name]), name
        else:
            assert torch.equal(value, without[name]), name
    prototypes = "scorer.prototype_score.point_prototypes"
    assert not torch.equal(own[prototypes], without[prototypes])
    assert not torch.equal(own["beta"], skill["beta"])
    assert not torch.equal(own["node_order"], skill["node_order"])
    assert float(own["reference_margin"]) == 0


def test_init_from_allows_other_demonstrations_objective_optimizer_and_seed(
    learn_unchecked: Learn, configured: Configured, elsewhere: np.ndarray, finished: Path
) -> None:
    config = configured(
        1,
        model={**NETWORK, "cascade": 8, "precision": "bfloat16", "memory_mb": 7},
        objective=ObjectiveConfig(top_k=1, sigma0=1.0),
        optimizer=OptimizerConfig(name="sgd", lr=1e-4),
        demonstration={"gap": 1, "batch_size": 2},
        seed=9,
        ema_decay=None,
    )
    learned = learn_unchecked(config, [elsewhere, elsewhere[:5]], init_from=finished, scene=SCENE)
    provenance = learned.skill.provenance
    assert (len(provenance.sources), provenance.seed, provenance.scene) == (2, 9, SCENE)
    assert learned.skill.members["p2p_sift"].spans.tolist() == [1, 2, 4]
    assert learned.skill.spec.model.arguments["cascade"] == 8


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kernel": "p2l"}, "has members p2p_sift; expected p2l_sift_lbd, as in this run"),
        ({"descriptor": "orb"}, "has members p2p_sift; expected p2p_orb, as in this run"),
        ({"descriptor": {"sift": {"root": True}}}, "has extractors .*'root': False.*; expected .*'root': True.*"),
        ({"model": {**NETWORK, "hidden_dim": 5}}, "has model .*'hidden_dim': 4.*expected .*'hidden_dim': 5.*"),
        ({"model": {**NETWORK, "layers": 2}}, "has model .*'layers': 1.*expected .*'layers': 2.*"),
        ({"model": "bilinear"}, "has model .*'message_passing'.*expected .*'bilinear'.*"),
        ({"features": 11}, "has features .*'max_features': 10.*expected .*'max_features': 11.*"),
    ],
)
def test_init_from_another_network_is_refused(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    finished: Path,
    settings: dict[str, Any],
    message: str,
) -> None:
    config = configured(**{"model": NETWORK, **settings} if "features" not in settings else {"model": NETWORK})
    if "features" in settings:
        config.features = replace(config.features, max_features=settings["features"])
    may = "; demonstrations, objective, optimizer and seed may differ"
    with pytest.raises(InputError, match=f"^{finished}: {message}{may}$") as caught:
        learn_unchecked(config, pictures, init_from=finished)
    assert "\n" not in str(caught.value)


def test_init_from_weights_that_do_not_fit_is_refused(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, finished: Path, tmp_path: Path
) -> None:
    path = tmp_path / "skill.ckpt"
    shutil.copy(finished, path)
    contents = torch.load(path, weights_only=True)
    del contents["state_dict"][next(name for name in contents["state_dict"] if ".scorer." in name)]
    torch.save(contents, path)
    with pytest.raises(InputError, match=rf"^{path}: its weights do not fit its specification \(.+\)$") as caught:
        learn_unchecked(configured(model=NETWORK), pictures, init_from=path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("where", "value"),
    [
        (("callbacks",), None),
        (("callbacks", "MetricsTable", "rows"), {"_target_": "os.getcwd"}),
        (("callbacks", "MetricsTable", "rows", 0, "step"), "x"),
        (("global_step",), -1),
        (("loops", "fit_loop", "epoch_progress", "current", "processed"), "x"),
        (("optimizer_states", 0, "param_groups", 0, "lr"), "${oc.env:HOME}"),
        (("optimizer_states", 0, "state", 0), {"_target_": "os.getcwd"}),
        (("current_model_state",), []),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_damaged_state_of_a_training_is_refused(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    finished: Path,
    tmp_path: Path,
    where: tuple[Any, ...],
    value: Any,
) -> None:
    """Whether this package reads it or Lightning does."""
    contents = entries = torch.load(finished, weights_only=True)
    for key in where[:-1]:
        entries = entries[key]
    entries[where[-1]] = value
    path = tmp_path / "damaged.ckpt"
    torch.save(contents, path)
    with pytest.raises(InputError, match=rf"^{path}: the state of its training .+; expected ") as caught:
        learn_unchecked(configured(2, model=NETWORK), pictures, resume=path)
    assert "\n" not in str(caught.value)


def test_a_training_may_go_on_elsewhere_and_longer(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, finished: Path
) -> None:
    """With other devices, threads and inference; it began when it began."""
    config = configured(
        2,
        model=NETWORK,
        threads=2,
        early_stopping=EarlyStoppingConfig(patience=5),
        trainer=TrainerConfig(max_epochs=2, limit_train_batches=3, accelerator="auto", enable_progress_bar=False),
    )
    learned = learn_unchecked(config, pictures, resume=finished)
    assert learned.skill.provenance.epochs == (2, 2)
    assert learned.skill.provenance.date == read_skill(finished).provenance.date
