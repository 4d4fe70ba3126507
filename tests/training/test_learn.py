"""``geoskill.learn``: from every kind of demonstration, quietly, with a skill that can be saved and loaded."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

import geoskill
from geoskill.config import EarlyStoppingConfig, TrainConfig
from geoskill.errors import InputError
from geoskill.io.arrays import ArrayFrames
from geoskill.io.camera import Camera
from geoskill.io.sources import open_frames
from geoskill.schema import as_plain
from geoskill.skill.checkpoint import Provenance, read_skill
from geoskill.skill.skill import Skill
from geoskill.training.callbacks import MetricsTable, SkillRecord
from geoskill.training.divergence import DivergenceGuard
from geoskill.training.learn import LearnedSkill
from geoskill.training.trainer import build_trainer

# What the fixtures of conftest.py make; see there.
Learn = Any
Configured = Callable[..., TrainConfig]
StateOf = Callable[[Skill], dict[str, torch.Tensor]]
NO_DEMONSTRATION = "a video file, a folder of images, or an array of pictures"


@pytest.fixture(scope="module")
def ensemble(learn_unchecked: Learn, configured: Configured, pictures: np.ndarray) -> LearnedSkill:
    """Return an ensemble of two members."""
    learned: LearnedSkill = learn_unchecked(configured(kernel=["p2p", "p2l"]), pictures)
    return learned


@pytest.fixture(scope="module")
def folder(pictures: np.ndarray, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures")
    for number, picture in enumerate(pictures):
        cv2.imwrite(str(path / f"{number:03d}.png"), picture[:, :, ::-1])
    return path


def assert_equal_states(state: dict[str, torch.Tensor], expected: dict[str, torch.Tensor]) -> None:
    assert list(state) == list(expected)
    for name, value in state.items():
        assert torch.equal(value, expected[name]), name


def assert_other_weights(state: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> None:
    for name, value in state.items():
        if ".scorer." in name:
            assert not torch.equal(value, other[name]), name


def test_learn_is_public() -> None:
    assert (geoskill.learn.__module__, geoskill.TrainConfig) == ("geoskill.training.learn", TrainConfig)
    assert geoskill.LearnedSkill is LearnedSkill


@pytest.mark.slow
def test_learn_takes_one_demonstration_in_every_form(
    ensemble: LearnedSkill,
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    folder: Path,
    state_of: StateOf,
) -> None:
    config = configured(kernel="p2p")
    expected = {name: value for name, value in state_of(ensemble.skill).items() if ".p2p_sift." in name}
    for demonstrations in (folder, str(folder), [folder], list(pictures), open_frames(folder), ArrayFrames(pictures)):
        learned = learn_unchecked(config, demonstrations)
        assert_equal_states(state_of(learned.skill), expected)


@pytest.mark.slow
def test_learn_takes_several_demonstrations_in_every_form(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, folder: Path, state_of: StateOf
) -> None:
    config = configured()
    expected = learn_unchecked(config, [pictures, pictures[:8]])
    assert expected.skill.provenance.sources == ("demonstration 1", "demonstration 2")
    alone = learn_unchecked(config, pictures)
    assert not torch.equal(
        state_of(alone.skill)["members.p2p_sift.beta"], state_of(expected.skill)["members.p2p_sift.beta"]
    )
    for demonstrations in (
        [list(pictures), list(pictures[:8])],
        [open_frames(folder), ArrayFrames(pictures[:8])],
        (source for source in (str(folder), pictures[:8])),
    ):
        assert_equal_states(state_of(learn_unchecked(config, demonstrations).skill), state_of(expected.skill))


def test_members_of_an_ensemble_equal_skills_learned_alone(
    ensemble: LearnedSkill, learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, state_of: StateOf
) -> None:
    assert list(ensemble.skill.members) == ["p2p_sift", "p2l_sift_lbd"]
    together = state_of(ensemble.skill)
    for kernel, member in (("p2p", "p2p_sift"), ("p2l", "p2l_sift_lbd")):
        alone = learn_unchecked(configured(kernel=kernel), pictures)
        assert_equal_states(
            state_of(alone.skill), {name: value for name, value in together.items() if f".{member}." in name}
        )
        for row, row_together in zip(alone.curves, ensemble.curves, strict=True):
            assert {name: row_together[name] for name in row} == row


def test_learned_statistics_are_complete(ensemble: LearnedSkill) -> None:
    for member in ensemble.skill.members.values():
        assert not member.training
        assert member.spans.tolist() == [2, 4]
        assert (member.beta > 0).all()
        assert float(member.reference_margin) > 0


def test_metrics_and_curves(ensemble: LearnedSkill) -> None:
    assert [(row["step"], row["epoch"]) for row in ensemble.curves] == [(1, 0), (2, 0), (3, 0), (4, 1), (5, 1), (6, 1)]
    quantities = ("objective", "reward", "rsw", "goal", "error")
    members = {f"{name}/{quantity}" for name in ("p2p_sift", "p2l_sift_lbd") for quantity in quantities}
    assert all(set(row) == {"step", "epoch", *members} for row in ensemble.curves)
    assert set(ensemble.metrics) == {"objective", "objective_epoch", "rsw", "steps", *members}
    assert ensemble.metrics["steps"] == 6
    assert {name: ensemble.metrics[name] for name in members} == {name: ensemble.curves[-1][name] for name in members}
    of_epoch = [
        np.mean([row[f"{name}/objective"] for name in ("p2p_sift", "p2l_sift_lbd")]) for row in ensemble.curves[3:]
    ]
    assert ensemble.metrics["objective_epoch"] == pytest.approx(np.mean(of_epoch), rel=1e-5)
    assert ensemble.is_main


def test_provenance_of_a_learned_skill(ensemble: LearnedSkill, configured: Configured) -> None:
    provenance = ensemble.skill.provenance
    assert (provenance.sources, provenance.image_size, provenance.seed) == (("demonstration 1",), (160, 120), 0)
    assert (provenance.finished, provenance.epochs, provenance.scene) == (True, (2, 2), None)
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", provenance.date)
    assert re.match(r"\d+\.\d+", provenance.version)
    assert provenance.configuration == as_plain(configured(kernel=["p2p", "p2l"]))
    assert {name: ensemble.metrics[name] for name in provenance.metrics} == dict(provenance.metrics)
    assert set(provenance.metrics) == {"objective", "objective_epoch", "rsw"}


def test_learn_prints_and_writes_nothing(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    learn_unchecked(configured(early_stopping=EarlyStoppingConfig(patience=5)), pictures)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_learn_writes_only_the_files_that_are_named(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path)
    learned = learn_unchecked(
        configured(), pictures, checkpoint=tmp_path / "run" / "a.ckpt", curves=str(tmp_path / "run" / "b.csv")
    )
    assert capfd.readouterr() == ("", "")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.ckpt", "b.csv", "run"]
    lines = (tmp_path / "run" / "b.csv").read_text().splitlines()
    assert len(lines) == 1 + len(learned.curves)
    assert lines[0].split(",") == list(learned.curves[0])


def test_saved_skill_loads_as_it_was(
    ensemble: LearnedSkill, pictures: np.ndarray, tmp_path: Path, state_of: StateOf
) -> None:
    ensemble.save(tmp_path / "skill.ckpt")
    loaded = Skill.load(tmp_path)
    assert_equal_states(state_of(loaded), state_of(ensemble.skill))
    assert (loaded.spec, loaded.provenance) == (ensemble.skill.spec, ensemble.skill.provenance)
    assert repr(loaded) == repr(ensemble.skill)
    for picture in pictures[:2]:
        assert loaded.infer(picture).associations == ensemble.skill.infer(picture).associations


@pytest.mark.parametrize("ema_decay", [0.99, None])
def test_finished_checkpoint_holds_the_returned_skill(
    learn_unchecked: Learn,
    configured: Configured,
    pictures: np.ndarray,
    tmp_path: Path,
    state_of: StateOf,
    ema_decay: float | None,
) -> None:
    learned = learn_unchecked(configured(ema_decay=ema_decay), pictures, checkpoint=tmp_path / "skill.ckpt")
    stored = read_skill(tmp_path)
    assert_equal_states(dict(stored.contents["state_dict"]), state_of(learned.skill))
    assert (stored.spec, stored.provenance) == (learned.skill.spec, learned.skill.provenance)
    without = learn_unchecked(configured(ema_decay=ema_decay), pictures)
    assert_equal_states(state_of(without.skill), state_of(learned.skill))
    assert ("current_model_state" in stored.contents) == (ema_decay is not None)
    if ema_decay is not None:
        assert_other_weights(stored.contents["current_model_state"], state_of(learned.skill))


def test_ema_decay_null_keeps_the_last_weights(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, tmp_path: Path, state_of: StateOf
) -> None:
    last = learn_unchecked(configured(ema_decay=None), pictures)
    learn_unchecked(configured(), pictures, checkpoint=tmp_path / "skill.ckpt")
    weights = torch.load(tmp_path / "skill.ckpt", weights_only=True)["current_model_state"]
    for name, value in state_of(last.skill).items():
        if ".scorer." in name:
            assert torch.equal(value, weights[name]), name


def test_callbacks_are_in_the_order_in_which_they_depend_on_each_other(
    configured: Configured, training: Any, tmp_path: Path
) -> None:
    config = configured(early_stopping=EarlyStoppingConfig(patience=1))
    provenance = Provenance(("tiles",), (160, 120), date="", version="", seed=0)
    record = SkillRecord(training.spec, provenance, {}, training.demonstration)
    trainer = build_trainer(
        config, DivergenceGuard(), MetricsTable(), record, tmp_path / "skill.ckpt", (), progress_bar=False
    )
    assert [type(callback).__name__ for callback in trainer.callbacks] == [
        "DivergenceGuard",
        "MetricsTable",
        "EMAWeightAveraging",
        "EarlyStopping",
        "SkillRecord",
        "ResumableCheckpoint",
    ]


def test_seed_decides_the_result(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, state_of: StateOf
) -> None:
    states = []
    for number, seed in enumerate((1, 1, 2)):
        torch.manual_seed(number)  # whatever was drawn before
        states.append(state_of(learn_unchecked(configured(seed=seed), pictures).skill))
    assert_equal_states(states[0], states[1])
    assert_other_weights(states[0], states[2])


def camera() -> Camera:
    """Return one that was opened, though this machine has none."""
    opened = Camera.__new__(Camera)
    opened._index = 3
    return opened


PICTURE = np.zeros((40, 50, 3), np.uint8)
WRONG_PICTURES = {
    "gray": (
        [PICTURE[:, :, 0]] * 4,
        r"demonstration 1: picture 0 is uint8 \[40, 50\]; expected uint8",
    ),
    "gray array": (np.zeros((4, 40, 50), np.uint8), r"demonstration 1: picture 0 is uint8 \[40, 50\]; expected uint8"),
    "one picture": (
        PICTURE,
        r"demonstration 1: picture 0 is uint8 \[50, 3\]; expected uint8 \[height, width",
    ),
    "floats": (np.zeros((4, 40, 50, 3), np.float32), r"demonstration 1: picture 0 is float32 \[40, 50, 3\]; expected"),
    "RGBA": (np.zeros((4, 40, 50, 4), np.uint8), r"demonstration 1: picture 0 is uint8 \[40, 50, 4\]; expected uint8"),
    "no picture": (np.zeros((0, 40, 50, 3), np.uint8), "demonstration 1: no picture; expected a demonstration$"),
    "no pixel": (
        np.zeros((4, 0, 50, 3), np.uint8),
        r"demonstration 1: picture 0 is uint8 \[0, 50, 3\]; expected",
    ),
    "sizes": (
        [PICTURE, PICTURE[:30], PICTURE],
        r"demonstration 1: picture 1 is \[30, 50, 3\]; expected that of",
    ),
    "lists": ([[[1, 2], [3]]], r"demonstration 1: picture 0 is list \[\]; expected uint8 \[height, width, 3\], RGB$"),
    "mixed": ([PICTURE, "a.mp4"], r"demonstration 1: picture 1 is .*; expected uint8 \[height, width, 3\], RGB$"),
    "too short": ([PICTURE] * 2, r"demonstration 1: 2 frame\(s\); expected at least 3$"),
    "featureless": (
        [PICTURE] * 4,
        "no frame of demonstration 1 has an association of p2p_sift; expected features",
    ),
}


@pytest.mark.parametrize("case", WRONG_PICTURES)
def test_learn_refuses_wrong_pictures(learn_unchecked: Learn, configured: Configured, case: str) -> None:
    demonstrations, message = WRONG_PICTURES[case]
    with pytest.raises(InputError, match=f"^{message}") as caught:
        learn_unchecked(configured(), demonstrations)
    assert "\n" not in str(caught.value)


def test_learn_names_the_wrong_one_of_several(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray
) -> None:
    with pytest.raises(InputError, match=r"^demonstration 2: picture 0 is uint8 \[40, 50\]; expected uint8 \[height,"):
        learn_unchecked(configured(), [pictures, np.zeros((4, 40, 50), np.uint8)])


@pytest.mark.parametrize(
    ("demonstrations", "message"),
    [
        ((), f"no demonstration; expected {NO_DEMONSTRATION}$"),
        ([], f"no demonstration; expected {NO_DEMONSTRATION}$"),
        (iter(()), f"no demonstration; expected {NO_DEMONSTRATION}$"),
        (None, f"demonstrations=None: expected {NO_DEMONSTRATION}$"),
        (0, f"demonstrations=0: expected {NO_DEMONSTRATION}$"),
        ([None], f"demonstration 1 is None; expected {NO_DEMONSTRATION}$"),
        ([7], f"demonstration 1 is 7; expected {NO_DEMONSTRATION}$"),
        ("/no/such.mp4", "'/no/such.mp4' does not exist; expected a video"),
        ([Path("/no/such")], "'/no/such' does not exist; expected a video"),
        ("", "'' does not exist; expected a video"),
        (camera(), "camera 3 is a camera; expected a video file or a folder of images$"),
        ("98", "camera 98: cannot be opened"),
    ],
    ids=lambda value: type(value).__name__ if not isinstance(value, str) else value[:30],
)
def test_learn_refuses_what_is_no_demonstration(
    learn_unchecked: Learn, configured: Configured, demonstrations: Any, message: str
) -> None:
    with pytest.raises(InputError, match=f"^{message}") as caught:
        learn_unchecked(configured(), demonstrations)
    assert "\n" not in str(caught.value)


def test_learn_refuses_a_demonstration_in_which_nothing_moves(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray
) -> None:
    with pytest.raises(InputError, match=r"p2p_sift") as caught:
        learn_unchecked(configured(), [pictures[4]] * 6)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"kernel": "p2q"}, "kernel=p2q: no such kernel; expected one of "),
        ({"descriptor": "lbd"}, "kernel=p2p joins a point, and lbd describes a line; expected a descriptor of a point"),
        ({"model": "large"}, "model=large: no such model; expected one of "),
        ({"model": {"name": "bilinear", "hidden": 8}}, "model=bilinear has no argument 'hidden'; expected hidden_dim$"),
        (
            {"model": {"name": "bilinear", "hidden_dim": 0}},
            "hidden_dim=0: expected a whole number of at least 1 and at most 4096$",
        ),
        (
            {"model": {"name": "message_passing", "cascade": 3}},
            "cascade=3: expected at least top_k=4, the assoc",
        ),
        ({"model": None}, "model=None: expected a name, or a mapping of name and arguments$"),
        ({"kernel": []}, r"kernel=\[\]: expected at least one of "),
    ],
)
def test_learn_refuses_a_wrong_configuration(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, settings: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=f"^{message}") as caught:
        learn_unchecked(configured(**settings), pictures)
    assert "\n" not in str(caught.value)


def test_three_frames_are_enough(learn_unchecked: Learn, configured: Configured, pictures: np.ndarray) -> None:
    """One transition there and, with negatives drawn for each, one back."""
    config = configured(1, demonstration={"max_span_ratio": 0, "num_negatives": 2})
    assert learn_unchecked(config, pictures[:3]).metrics["steps"] >= 1


@pytest.mark.slow
def test_auto_learns_as_the_kernels_that_it_keeps(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, state_of: StateOf, tmp_path: Path
) -> None:
    settings = {"demonstration": {"num_negatives": 5}}
    learned = learn_unchecked(configured(kernel="auto", **settings), pictures, checkpoint=tmp_path / "skill.ckpt")
    choice = learned.skill.provenance.choice
    assert choice is not None
    assert choice.kept == tuple(learned.skill.members)
    assert {own.partition("_")[0] for own in (*choice.kept, *choice.dropped)} == {"p2p", "p2l", "l2l", "par"}
    kernels = [name.partition("_")[0] for name in choice.kept]
    named = learn_unchecked(configured(kernel=kernels, **settings), pictures)
    ours, theirs = state_of(learned.skill), state_of(named.skill)
    assert ours.keys() == theirs.keys()
    assert all(torch.equal(ours[name], theirs[name]) for name in ours)
    assert set(learned.skill.pipelines) == set(named.skill.pipelines)
    assert Skill.load(tmp_path / "skill.ckpt").provenance.choice == choice


@pytest.mark.slow
def test_auto_goes_on_with_what_it_kept(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, state_of: StateOf, tmp_path: Path
) -> None:
    path = tmp_path / "skill.ckpt"
    whole = learn_unchecked(configured(epochs=3, kernel="auto"), pictures)
    learn_unchecked(configured(epochs=1, kernel="auto"), pictures, checkpoint=path)
    resumed = learn_unchecked(configured(epochs=3, kernel="auto"), pictures, resume=path)
    assert resumed.skill.provenance.choice == whole.skill.provenance.choice
    ours, theirs = state_of(resumed.skill), state_of(whole.skill)
    assert all(torch.equal(ours[name], theirs[name]) for name in theirs)
    again = learn_unchecked(configured(epochs=1, kernel="auto"), pictures, init_from=path)
    assert again.skill.provenance.choice == whole.skill.provenance.choice
    assert list(again.skill.members) == list(whole.skill.members)


@pytest.mark.parametrize("kernel", [["auto", "p2p"], {"auto": {"x": 1}}, {"auto": {}, "l2l": {}}])
def test_auto_stands_alone(kernel: Any, pictures: np.ndarray) -> None:
    with pytest.raises(InputError, match=r"^kernel=.*: expected auto alone, or the names of kernels$"):
        geoskill.learn(TrainConfig(kernel=kernel), pictures)
