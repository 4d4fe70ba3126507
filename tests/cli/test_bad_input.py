"""Bad input: one line that names key, value and expectation, the right exit status, and nothing written or lost."""

import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
import torch

from geoskill.cli.command import UNUSABLE_INPUT, explain
from geoskill.cli.compose import compose_training
from geoskill.cli.schemas import RENAMED

Command = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[2]


def check_error(ended: Any, status: int, *words: str) -> None:
    """One line on standard error that holds all the words, and nothing else there."""
    assert ended.status == status, ended.stderr
    lines = ended.stderr.splitlines()
    assert len(lines) == 1, ended.stderr
    assert lines[0].startswith("error: ")
    for word in words:
        assert word in lines[0]


def write_images(folder: Path, images: Sequence[np.ndarray]) -> Path:
    folder.mkdir()
    for number, image in enumerate(images):
        cv2.imwrite(str(folder / f"{number:03d}.png"), image[:, :, ::-1])
    return folder


def write_video(path: Path, frames: Sequence[np.ndarray]) -> Path:
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "0"})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode(None))
    return path


def snapshot(folder: Path) -> dict[str, bytes]:
    """The results of a run; what Hydra notes about the last command is not among them."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and ".hydra" not in path.parts and path.suffix != ".log"
    }


@pytest.fixture
def refused(command: Command, tiny: Sequence[str], tmp_path: Path) -> Callable[..., None]:
    """``refused(2, ["seed=x"], "seed=x", "whole number")``: such a training ends like that and writes no result."""

    def check(status: int, overrides: Sequence[str], *words: str) -> None:
        run = tmp_path / "run"
        ended = command("train", *tiny, *overrides, f"hydra.run.dir={run}")
        check_error(ended, status, *words)
        if run.exists():
            assert snapshot(run) == {}

    return check


def check_composition_is_refused(overrides: Sequence[str], *words: str) -> None:
    """What composition refuses is told in one line; the commands print it (``test_value_of_the_command``)."""
    status, line = 0, ""
    try:
        compose_training(*overrides)
    except Exception as error:
        status, message = explain(error, "train")
        line = f"error: {message}"
    assert status == UNUSABLE_INPUT
    assert "\n" not in line
    assert all(word in line for word in words), line


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("see=1", ["'see'", "no such key; expected seed, or one of --cfg job"]),
        ("model.width=3", ["'model.width'", "no such key; expected ", "--cfg job"]),
        ("model.hiden_dim=3", ["'model.hiden_dim'", "expected model.hidden_dim, or one of --cfg job"]),
        ("objective.sigma=1", ["'objective.sigma'", "expected objective.sigma0, or one of --cfg job"]),
        ("logger.wandb.team=me", ["'logger.wandb.team'", "--cfg job"]),
        ("+model.width=3", ["'model.width'", "no such key"]),
        ("+objective.width=3", ["'objective.width'", "no such key"]),
        ("+trainer.width=3", ["'trainer.width'", "no such key"]),
        ("++trainer.width=3", ["'trainer.width'", "no such key"]),
        ("+descriptor.sift.roots=true", ["'descriptor.sift.roots'", "expected descriptor.sift.root, or one of --cfg"]),
        ("+see=1", ["'see'", "no such key; expected seed, or one of --cfg job"]),
        ("~trainer.width", ["'trainer.width'", "no such key"]),
        ("kernel.p2p.size=3", ["'kernel.p2p.size'", "no such key"]),
        ("descriptor.sift.roots=true", ["'descriptor.sift.roots'", "expected descriptor.sift.root, or one of --cfg"]),
        ("kernell=p2p", ["'kernell'", "expected kernel, or one of --cfg job"]),
        ("kernel=p3p", ["kernel/p3p", "p2p"]),
        ("kernel=[p2p,p3p]", ["kernel", "p3p"]),
        ("descriptor=surf", ["descriptor/surf", "sift"]),
        ("model=transformer", ["model/transformer", "message_passing"]),
        ("task=welding", ["task/welding", "sorting", "video"]),
        ("scenario=fog", ["scenario/fog", "illumination"]),
        ("experiment=papers", ["experiment/papers", "paper"]),
    ],
)
def test_unknown_keys_and_choices(monkeypatch: pytest.MonkeyPatch, override: str, words: Sequence[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["train.py", "task=video", override])  # where the message looks for choices
    check_composition_is_refused(["task=video", override], *words)


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed", ["'seed'", "EQUAL"]),
        ("+kernel.p2p.size=3", ["kernel=p2p has no argument 'size'; expected no arguments"]),
        ("task=insertion", ["'task.path'", "no such key", "task=video"]),  # a simulated task has no path
        ("--kernel", ["--kernel", "KEY=VALUE"]),
        ("demonstration.gap=20", ["20 frame(s)", "at least 21"]),
        ("task.path=null", ["task.path is not set", "task=video", "task.path=DIR_OR_FILE"]),
        ("task.path=/no/such/video.mp4", ["/no/such/video.mp4", "expected a video"]),
        ("task.regions=/no/such.json", ["/no/such.json", "regions file"]),
        ("ckpt_path=/no/such.ckpt", ["/no/such.ckpt", "skill.ckpt"]),
        ("init_from=/no/such.ckpt", ["/no/such.ckpt", "skill.ckpt"]),
    ],
)
def test_overrides(refused: Callable[..., None], override: str, words: Sequence[str]) -> None:
    refused(2, [override], *words)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("seed=abc", "a whole number of at least 0"),
        ("seed=1.5", "a whole number of at least 0"),
        ("seed=null", "a whole number of at least 0"),
        ("seed=true", "a whole number of at least 0"),
        ("seed=-1", "a whole number of at least 0"),
        ("threads=x", "a whole number of at least 1, or null"),
        ("threads=0", "a whole number of at least 1, or null"),
        ("debug=1", "true or false"),
        ("debug=yes", "true or false"),
        ("debug=null", "true or false"),
        ("model.hidden_dim=0", "a whole number of at least 1"),
        ("model.hidden_dim=x", "a whole number of at least 1"),
        ("objective.sigma0=-1", "a number of at least 0.001 and at most 1000"),
        ("objective.sigma0=x", "a number of at least 0.001 and at most 1000"),
        ("objective.sigma0=nan", "a number of at least 0.001 and at most 1000"),
        ("objective.sigma0=inf", "a number of at least 0.001 and at most 1000"),
        ("objective.rsw_weight=inf", "a number of at least 0"),
        ("objective.reward=frames", "tracked or frame"),
        ("objective.reward=1", "tracked or frame"),
        ("objective.change=null", "relative or absolute"),
        ("objective.goal_temperature=0", "a number above 0"),
        ("features.max_features=1", "a whole number of at least 2"),
        ("features.min_side=-1", "a whole number of at least 0"),
        ("features.color=-1", "a number of at least 0"),
        ("trainer.max_epochs=x", "a whole number of at least 1"),
        ("trainer.max_epochs=0", "a whole number of at least 1"),
        ("trainer.max_epochs=-4", "a whole number of at least 1"),
        ("trainer.limit_train_batches=x", "a whole number or a number above 0, or null"),
        ("trainer.limit_train_batches=0", "a whole number or a number above 0, or null"),
        ("trainer.gradient_clip_val=x", "a number above 0, or null"),
        ("trainer.accelerator=abacus", "cpu, gpu, cuda, mps or auto"),
        ("trainer.enable_progress_bar=1", "true or false"),
        ("demonstration.gap=0", "a whole number of at least 1"),
        ("demonstration.gap=x", "a whole number of at least 1"),
        ("demonstration.max_span_ratio=2", "a number of at least 0 and at most 1"),
        ("demonstration.max_visible_features=1", "a whole number of at least 2, or null"),
        ("demonstration.max_visible_features=x", "a whole number of at least 2, or null"),
        ("demonstration.batch_size=0", "a whole number of at least 1"),
        ("demonstration.descriptor_noise=-1", "a number of at least 0"),
        ("demonstration.feature_dropout=1", "a number of at least 0 and below 1"),
        ("demonstration.num_negatives=-1", "a whole number of at least 0"),
        ("inference.temporal=often", "none or filter"),
        ("inference.temporal=null", "none or filter"),
        ("inference.abstain=1.5", "a number of at least 0 and at most 1"),
        ("inference.top_k=0", "a whole number of at least 1"),
        ("inference.min_drawn_weight=x", "a number of at least 0 and at most 1"),
        ("optimizer.name=lion", "adam, adamw or sgd"),
        ("optimizer.lr=-1", "a number above 0"),
        ("optimizer.lr=x", "a number above 0"),
        ("ema_decay=1", "a number of at least 0 and below 1, or null"),
        ("early_stopping.patience=x", "a whole number of at least 0, or null"),
        ("early_stopping.patience=-1", "a whole number of at least 0, or null"),
        ("cache.limit_mb=0", "a number above 0"),
        ("cache.enabled=0", "true or false"),
        ("task.frame_rate=0", "a number of at least 0.01 and at most 10000, or null"),
        ("task.frame_rate=0.001", "a number of at least 0.01 and at most 10000, or null"),
        ("task.frame_rate=x", "a number of at least 0.01 and at most 10000, or null"),
        ("task.every=0", "a whole number of at least 1"),
        ("descriptor.sift.root=1", "true or false"),
        ("descriptor.sift.contrast_threshold=x", "a number"),
        ("features=3", "FeaturesConfig"),
        ("features=null", "FeaturesConfig"),
    ],
)
def test_values(override: str, expected: str) -> None:
    check_composition_is_refused(["task=video", override], f"error: {override}: expected {expected}")


@pytest.mark.parametrize(
    ("override", "expected"), [("seed=abc", "a whole number"), ("objective.sigma0=-1", "a number")]
)
def test_value_of_the_command(refused: Callable[..., None], override: str, expected: str) -> None:
    refused(2, [override], f"error: {override}: expected {expected}")


@pytest.mark.parametrize("old", RENAMED)
def test_renamed_keys(command: Command, old: str, tmp_path: Path) -> None:
    for sign in ("", "+", "++"):
        ended = command("train", f"{sign}{old}=1", f"hydra.run.dir={tmp_path / 'run'}")
        check_error(ended, 2, f"error: {old}: is called {RENAMED[old]} now")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["model.cascade=0"], ["model.cascade=0: expected a whole number of at least 1, or null"]),
        (["model.cascade=9"], ["cascade=9: expected at least top_k=10", "or null"]),
        (["model.cascade=9", "inference.top_k=11"], ["cascade=9: expected at least top_k=11", "or null"]),
        (["model.cascade=x"], ["model.cascade=x: expected a whole number of at least 1, or null"]),
        (["model=paper", "model.cascade=1.5"], ["model.cascade=1.5: expected a whole number of at least 1, or null"]),
        (["model=bilinear", "model.cascade=64"], ["'model.cascade'", "--cfg job"]),
    ],
)
def test_cascades(refused: Callable[..., None], overrides: Sequence[str], words: Sequence[str]) -> None:
    refused(2, ["model=default", *overrides], *words)


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        ("early_stopping.patience=x", "a whole number of at least 0, or null"),
        ("trainer.gradient_clip_val=x", "a number above 0, or null"),
        ("trainer.limit_train_batches=x", "a whole number or a number above 0, or null"),
        ("ema_decay=x", "a number of at least 0 and below 1, or null"),
    ],
)
def test_values_that_the_paper_leaves_out(override: str, expected: str) -> None:
    overrides = ["task=video", "experiment=paper", override]
    check_composition_is_refused(overrides, f"error: {override}: expected {expected}")


@pytest.mark.skipif(torch.cuda.is_available() or torch.backends.mps.is_available(), reason="there is a GPU")
def test_no_gpu(refused: Callable[..., None]) -> None:
    refused(2, ["trainer=gpu"], "accelerator=gpu", "no GPU", "trainer=cpu")


@pytest.mark.slow
def test_help_into_a_closed_pipe() -> None:
    command = [sys.executable, "-m", "geoskill.cli.train", "--help"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as reader:
        assert reader.stdout is not None
        assert reader.stderr is not None
        reader.stdout.close()
        assert b"Error" not in reader.stderr.read()
    assert reader.returncode == 1


def test_kernel_without_its_descriptor(refused: Callable[..., None]) -> None:
    refused(2, ["kernel=l2l", "descriptor=sift"], "kernel=l2l", "line", "sift describes a point")


@pytest.fixture
def simulated(tiny: Sequence[str]) -> list[str]:
    """The same small training, of a simulated demonstration."""
    return [override for override in tiny if not override.startswith("task")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("scenario.actor=dog", ["scenario.actor=dog: expected human or robot"]),
        ("scenario.severity=9", ["scenario.severity=9: expected a number of at least 0 and at most 1.5"]),
        ("scenario.severity=x", ["scenario.severity=x: expected a number of at least 0 and at most 1.5"]),
        ("scenario.confidence=0", ["scenario.confidence=0: expected a number above 0 and at most 1"]),
        ("scenario.occlusion=1", ["scenario.occlusion=1: expected true or false"]),
        ("scenario.fog=true", ["'scenario.fog'", "no such key"]),
        ("scenario=fog", ["scenario/fog", "illumination"]),
        ("seed=-1", ["seed=-1: expected a whole number of at least 0"]),
        ("task.every=0", ["task.every=0: expected a whole number of at least 1"]),
        ("task.num_demonstrations=0", ["task.num_demonstrations=0: expected a whole number of at least 1"]),
        ("task.name=welding", ["task=welding", "no such task", "sorting"]),
    ],
)
def test_simulated_trainings(
    command: Command, simulated: Sequence[str], tmp_path: Path, override: str, words: Sequence[str]
) -> None:
    ended = command("train", *simulated, override, f"hydra.run.dir={tmp_path}")
    check_error(ended, 2, *words)
    assert snapshot(tmp_path) == {}


def test_missing_opengl(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import mujoco

    def fail(*_: object) -> None:
        raise RuntimeError("no display")

    monkeypatch.setattr(mujoco, "Renderer", fail)
    ended = command("train", "cache.enabled=false", "logger=none", f"hydra.run.dir={tmp_path}")
    check_error(ended, 2, "no OpenGL context for rendering (RuntimeError: no display)", "apt-get install libegl1")


@pytest.mark.slow
def test_folders_and_videos(
    refused: Callable[..., None], demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    refused(2, [f"task.path={empty}"], str(empty), "no image")

    no_bytes = tmp_path / "empty.mp4"
    no_bytes.touch()
    refused(2, [f"task.path={no_bytes}"], str(no_bytes), "empty", "expected a complete video")

    text = tmp_path / "text.mp4"
    text.write_text("not a video")
    refused(2, [f"task.path={text}"], str(text), "expected a complete video")

    whole = write_video(tmp_path / "whole.mp4", demonstration_frames)
    cut = tmp_path / "cut.mp4"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    refused(2, [f"task.path={cut}"], str(cut), "breaks at frame", "expected a complete video")

    single = write_video(tmp_path / "single.mp4", demonstration_frames[:1])
    refused(2, [f"task.path={single}"], str(single), "1 frame(s)", "at least 3")

    black = write_images(tmp_path / "black", [np.zeros_like(demonstration_frames[0])] * 5)
    refused(2, [f"task.path={black}"], "no frame", "p2p_sift", "features of type point")

    refused(2, [f"task.path=[{whole},{single}]"], str(single), "1 frame(s)", "at least 3")
    refused(2, [f"task.path=[{whole},{black}]"], f"no frame of {black}", "p2p_sift")
    refused(2, [f"task.path=[{whole},{tmp_path / 'none'}]"], str(tmp_path / "none"), "does not exist")
    refused(2, ["task.path=[]"], "task.path is not set", "task.path=[a.mp4,b.mp4]")

    still = write_images(tmp_path / "still", [demonstration_frames[0]] * 5)
    refused(2, [f"task.path={still}"], "nothing moves", "expected a video of a task being done")

    damaged = write_images(tmp_path / "damaged", demonstration_frames[:5])
    (damaged / "003.png").write_bytes((damaged / "003.png").read_bytes()[:200])
    refused(2, [f"task.path={damaged}"], str(damaged / "003.png"), "damaged")

    sizes = write_images(tmp_path / "sizes", [*demonstration_frames[:4], demonstration_frames[4][:100]])
    refused(2, [f"task.path={sizes}"], str(sizes / "004.png"), "160x100", "160x120")


@pytest.mark.slow
def test_regions_that_do_not_fit(refused: Callable[..., None], tmp_path: Path) -> None:
    frame: dict[str, Any] = {"object": [[0, 0], [9, 0], [9, 9]], "target": [], "hand": []}
    path = tmp_path / "regions.json"
    for content, words in (
        ({"image_size": [120, 160], "frames": {"0": frame}}, ["120x160", "160x120"]),
        ({"image_size": [160, 120], "frames": {"20": frame}}, ["frame 20", "20 frames"]),
        ({"image_size": [160, 120], "frames": {"0": {"object": []}}}, ["frame 0", "target"]),
        ({"frames": {"0": frame}}, ["image_size"]),
    ):
        path.write_text(json.dumps(content))
        refused(2, [f"task.regions={path}"], str(path), *words)
    path.write_text(json.dumps({"image_size": [160, 120], "frames": {"0": frame}}))
    refused(2, [f"task.regions={path}", "task.every=0"], "task.every=0: expected a whole number of at least 1")
    path.write_text(json.dumps({"image_size": [160, 120], "frames": {"3": frame, "4": frame}}))
    refused(2, [f"task.regions={path}", "task.every=5"], str(path), "labels frames 3 to 4", "20 frames", "every=5")


@pytest.mark.slow
def test_checkpoints_to_resume_from(refused: Callable[..., None], skill: Path, tmp_path: Path) -> None:
    # `skill` is a finished p2p training of 2 epochs.
    refused(2, ["kernel=par", f"ckpt_path={skill}"], "has members p2p_sift; expected par_lbd")
    refused(2, ["model.hidden_dim=16", f"ckpt_path={skill}"], str(skill), "model", "'hidden_dim': 8", "16")
    refused(
        2,
        ["trainer.max_epochs=3", "demonstration.gap=3", f"ckpt_path={skill}"],
        *(str(skill), "was trained with demonstration.gap=2; expected demonstration.gap=3, as in this run"),
    )
    cut = tmp_path / "cut.ckpt"
    cut.write_bytes(skill.read_bytes()[:5000])
    refused(2, [f"ckpt_path={cut}"], str(cut), "cannot be read as a checkpoint")


@pytest.mark.slow
def test_skills_and_videos_of_infer(
    command: Command,
    skill: Path,
    demonstration_folder: Path,
    demonstration_frames: tuple[np.ndarray, ...],
    tmp_path: Path,
) -> None:
    run = f"hydra.run.dir={tmp_path / 'run'}"
    video = f"video={demonstration_folder}"
    check_error(command("infer", video, run), 2, "skill is not set", "skill=")
    check_error(command("infer", f"skill={skill}", run), 2, "video is not set", "video=")
    check_error(command("infer", f"skill={tmp_path / 'no.ckpt'}", video, run), 2, "no.ckpt", "no such file")
    check_error(command("infer", f"skill={skill}", "video=/no/such", run), 2, "/no/such", "does not exist")
    check_error(command("infer", f"skill={skill}", "video=98", run), 2, "camera 98", "cannot be opened")
    check_error(command("infer", f"skill={skill}", video, "device=gpu", run), 2, "device=gpu", "cpu")
    check_error(
        command("infer", f"skill={skill}", video, "precision=bfloat16", run), 2, "precision=bfloat16", "Bilinear"
    )
    check_error(command("infer", f"skill={skill}", video, "minimum_weight=x", run), 2, "minimum_weight: is called")
    check_error(
        command("infer", f"skill={skill}", video, "inference.min_drawn_weight=x", run),
        2,
        "min_drawn_weight=x: expected",
    )
    check_error(command("infer", f"skill={skill}", video, "inference.abstain=-1", run), 2, "inference.abstain=-1")
    check_error(command("infer", f"skill={skill}", video, "inference.temporal=1", run), 2, "inference.temporal=1")
    check_error(command("infer", f"skill={skill}", video, "frame_rate=x", run), 2, "frame_rate=x", "number")
    check_error(command("infer", f"skill={skill}", video, "seed=1", run), 2, "'seed'", "--cfg job")
    check_error(command("infer", f"skill={skill}", video, "threads=0", run), 2, "threads=0", "at least 1")
    check_error(command("infer", f"skill={skill}", video, "threads=x", run), 2, "threads=x", "whole number")

    corrupt = tmp_path / "corrupt.ckpt"
    for content in (b"", b"no checkpoint", skill.read_bytes()[:-3000]):
        corrupt.write_bytes(content)
        check_error(command("infer", f"skill={corrupt}", video, run), 2, str(corrupt), "expected the skill.ckpt")
    torch.save({"weights": torch.zeros(3)}, corrupt)
    check_error(command("infer", f"skill={corrupt}", video, run), 2, str(corrupt), "expected the skill.ckpt")
    stored = torch.load(skill, weights_only=True)
    stored["state_dict"] = {key: value.reshape(-1)[:1] for key, value in stored["state_dict"].items()}
    torch.save(stored, corrupt)
    check_error(command("infer", f"skill={corrupt}", video, run), 2, str(corrupt), "weights do not fit")
    for name, words in (("os.getcwd", ["expected the name of a class"]), ("p2p", ["no such descriptor"])):
        stored["skill"]["specification"]["extractors"]["sift"]["name"] = name
        torch.save(stored, corrupt)
        check_error(command("infer", f"skill={corrupt}", video, run), 2, str(corrupt), name, *words)
    assert snapshot(tmp_path / "run") == {}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["task=sorting", "video=DIR"], ["task and video are both set"]),
        (["task=sorting", "regions=FILE"], ["task and video are both set"]),
        (["task=video"], ["task=video is no simulated task", "task=sorting", "regions="]),
        (["task=welding"], ["task/welding", "sorting"]),
        (["task=sorting", "scenario=fog"], ["scenario/fog", "illumination"]),
        # Before anything is read or rendered.
        (
            ["task=sorting", "skill=no.ckpt", "inference.temporal=often"],
            ["inference.temporal=often: expected none or filter"],
        ),
        (
            ["task=sorting", "scenario.severity=9"],
            ["scenario.severity=9: expected a number of at least 0 and at most 1.5"],
        ),
        (
            ["task=sorting", "scenario=human", "scenario.confidence=0"],
            ["scenario.confidence=0: expected a number above 0"],
        ),
        (["task=sorting", "scenario.actor=dog"], ["scenario.actor=dog: expected human or robot"]),
        (["task=sorting", "seed=abc"], ["seed=abc: expected a whole number of at least 0, or null"]),
        (["task=sorting", "seed=-1"], ["seed=-1: expected a whole number of at least 0, or null"]),
        (["task=sorting", "every=0"], ["every=0: expected a whole number of at least 1"]),
        (["task=sorting", "inference.abstain=x"], ["inference.abstain=x: expected a number"]),
        (["scenario=occlusion"], ["video is not set", "task=…"]),
    ],
)
def test_simulated_evaluations(
    command: Command, skill: Path, tmp_path: Path, overrides: Sequence[str], words: Sequence[str]
) -> None:
    check_error(command("evaluate", f"skill={skill}", *overrides, f"hydra.run.dir={tmp_path}"), 2, *words)
    assert snapshot(tmp_path) == {}


def test_evaluate(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    regions = tmp_path / "regions.json"
    frame = {"object": [[0, 0], [9, 0], [9, 9]], "target": [], "hand": []}
    regions.write_text(json.dumps({"image_size": [160, 120], "frames": {"3": frame}}))
    run = f"hydra.run.dir={tmp_path / 'run'}"
    given = [f"skill={skill}", f"video={demonstration_folder}", f"regions={regions}", run]
    check_error(command("evaluate", *given, "regions=null"), 2, "regions is not set", "regions=")
    check_error(command("evaluate", *given, "every=0"), 2, "every=0: expected a whole number of at least 1")
    check_error(command("evaluate", *given, "every=5"), 2, str(regions), "labels frames 3 to 3", "every=5")
    regions.write_text(json.dumps({"image_size": [160, 120], "frames": {"20": frame}}))
    check_error(command("evaluate", *given), 2, str(regions), "frame 20", "20 frames")
    assert snapshot(tmp_path / "run") == {}


@pytest.mark.slow
def test_failing_run_leaves_earlier_results(
    command: Command,
    tiny: Sequence[str],
    trained: Any,
    skill: Path,
    demonstration_frames: tuple[np.ndarray, ...],
    tmp_path: Path,
) -> None:
    run = tmp_path / "run"
    shutil.copytree(trained.folder, run)
    before = snapshot(run)
    assert {"skill.ckpt", "associations.jsonl", "overlay.mp4", "metrics.json"} <= before.keys()
    still = write_images(tmp_path / "still", [demonstration_frames[0]] * 5)
    check_error(command("train", *tiny, f"task.path={still}", f"hydra.run.dir={run}"), 2, "nothing moves")
    assert snapshot(run) == before
    # Here the failure comes when some frames have been worked off.
    broken = write_images(tmp_path / "broken", demonstration_frames[:5])
    (broken / "003.png").write_bytes(b"")
    check_error(command("infer", f"skill={skill}", f"video={broken}", f"hydra.run.dir={run}"), 2, "003.png")
    assert snapshot(run) == before


def test_damaged_video_leaves_the_results_up_to_the_damage(
    command: Command, skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    broken = write_images(tmp_path / "broken", demonstration_frames[:5])
    (broken / "003.png").write_bytes(b"")
    check_error(command("infer", f"skill={skill}", f"video={broken}", f"hydra.run.dir={run}"), 2, "003.png")
    lines = (run / "associations.jsonl").read_text().splitlines()
    assert {json.loads(line)["frame"] for line in lines} == {0, 1, 2}
    assert json.loads((run / "metrics.json").read_text())["frames"] == 3
    assert (run / "overlay.mp4").is_file()


def test_debug_shows_the_traceback(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    ended = command("train", *tiny, "objective.sigma0=-1", "debug=true", f"hydra.run.dir={tmp_path}")
    assert ended.status == 2
    assert "Traceback (most recent call last)" in ended.stderr
    assert "in check_value" in ended.stderr
    assert ended.stderr.splitlines()[-1].startswith("error: objective.sigma0")


@pytest.mark.slow
def test_program_error_has_status_1(
    command: Command, tiny: Sequence[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("two\nlines")

    monkeypatch.setattr("geoskill.training.learn.fit_statistics", fail)
    ended = command("train", *tiny, f"hydra.run.dir={tmp_path}")
    check_error(ended, 1, "ZeroDivisionError: two lines", "debug=true")


@pytest.fixture
def small_disk(tmp_path: Path) -> Any:
    """Runs a script where there is room for 300 kB: on a file system of that size, or else with files up to it."""
    mount = tmp_path / "disk"
    mount.mkdir()
    limited = 300_000
    mounted = shutil.which("mount") is not None and (
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={limited}", "tmpfs", str(mount)], capture_output=True, check=False
        ).returncode
        == 0
    )

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limited, limited))

    yield mount, ({} if mounted else {"preexec_fn": limit})
    if mounted:
        subprocess.run(["umount", str(mount)], check=True)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of files and tmpfs are Linux's")
def test_full_disk(script: Command, tiny: Sequence[str], trained: Any, skill: Path, small_disk: Any) -> None:
    disk, settings = small_disk
    run = disk / "run"
    # Weights, gradients' moments: 64 kB fit twice, 600 kB do not fit.
    ended = script("train", *tiny, "model.hidden_dim=400", "cache.enabled=false", f"hydra.run.dir={run}", **settings)
    check_error(ended, 1, str(run), "no space left")
    assert not list(run.glob("*.part"))
