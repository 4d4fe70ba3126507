"""``python reproduce.py``: its refusals, and whole small studies that are stopped, fail and go on."""

import json
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from omegaconf import OmegaConf

from geoskill.cli.command import FAILED_RUN, configuration_folder
from geoskill.cli.compose import compose_training
from geoskill.schema import as_plain

Command = Callable[..., Any]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "error: artifact.data is not set; expected the folder of the labeled sequences (artifact.data=DIR)"),
        (["artifact.data=nowhere"], "error: artifact.data=nowhere: has no folder human1; expected one with frames"),
        (["artifact=table9"], "error: In 'reproduce': Could not find 'artifact/table9'"),
        (["artifact=table1", "jobs=0"], "error: jobs=0: expected a whole number of at least 1"),
        (["artifact=table1", "+artifact.rows={}"], "error: artifact.rows: there is no such key; expected one of name,"),
    ],
)
def test_bad_input(command: Command, tmp_path: Path, arguments: Sequence[str], message: str) -> None:
    ended = command("reproduce", *arguments, f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith(message)


def variant_overrides() -> list[str]:
    folder = Path(configuration_folder()) / "artifact"
    variants = [overrides for path in folder.glob("*.yaml") for overrides in OmegaConf.load(path).variants.values()]
    return sorted({override for overrides in variants for override in overrides})


@pytest.fixture(scope="module")
def default_configuration() -> Any:
    return as_plain(compose_training())


@pytest.mark.slow
@pytest.mark.parametrize("override", variant_overrides())
def test_variants_change_what_training_takes(default_configuration: Any, override: str) -> None:
    changed = as_plain(compose_training(override))  # which checks the value against type and range of its key
    # The ablations have the default among their values.
    defaults = ("objective.sigma0=0.55", "objective.rsw_weight=0.1", "model.layers=3", "task=sorting")
    assert changed != default_configuration or override in defaults


@pytest.mark.slow
def test_quick_study_in_parallel(script: Command, study_file: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    arguments = ["--config-dir", str(study_file), "artifact=tiny", "jobs=2", "quick=true", f"hydra.run.dir={run}"]
    ended = script("reproduce", *arguments)
    assert (ended.status, ended.stderr, ended.folder) == (0, "", run / "quick")
    scores = json.loads((run / "quick" / "table.json").read_text())["scores"]
    assert [(variant, [training["seed"] for training in trainings]) for variant, trainings in scores.items()] == [
        ("default", [3]),
        ("sigma0=1", [3]),
    ]
    assert scores["default"][0]["robot1"]["frames"] == 2
    assert scores["default"][0]["objective"] != scores["sigma0=1"][0]["objective"]
    markdown = (run / "quick" / "table.md").read_text()
    assert markdown in ended.stdout
    assert "(published 50.0)" in markdown
    assert len((run / "quick" / "table.csv").read_text().splitlines()) == 5
    assert [row["variant"] for row in json.loads((run / "quick" / "summary.json").read_text())] == list(scores)
    for name in ("accuracy.png", "reliability.png", "training.png", "summary.png"):
        assert (run / "quick" / name).stat().st_size > 0
    assert sorted(path.name for path in run.iterdir()) == [".hydra", "quick", "reproduce.log"]


@pytest.mark.slow
def test_study_goes_on_after_a_kill_and_a_failure(
    command: Command, study_file: Path, tiny: Sequence[str], tmp_path: Path
) -> None:
    run = tmp_path / "run"
    options = ["artifact=tiny", "jobs=1", "hydra/launcher=basic", f"hydra.run.dir={run}"]
    arguments = ["--config-dir", str(study_file), *options, "artifact.seeds=[3]", "~artifact.test_sets.human1"]
    regions = tmp_path / "data" / "robot1.regions.json"
    kept = regions.read_text()
    regions.write_text("{}")
    ended = command("reproduce", *arguments)
    first = run / "full" / "default" / "3"
    assert ended.status == 2
    assert ended.stderr.count("\n") == 1
    assert ended.stderr.startswith(f"error: 2 run(s) failed, first default, seed 3 ({first}): {regions}: ")
    assert ended.folder == run / "full"
    assert (first / "metrics.json").is_file()
    assert f"sigma0=1, seed 3: failed with status 2 {regions}: " in ended.stdout
    assert (first / FAILED_RUN).is_file()
    assert not (run / "full" / "table.md").exists()

    # As if killed in the second epoch of one training, and before its results in the other.
    regions.write_text(kept)
    curves = (first / "metrics.csv").read_text()
    shutil.rmtree(first)
    settings = [override for override in tiny if not override.startswith("trainer.max_epochs")]
    partial = command(
        "train",
        "task=video",
        f"task.path={tmp_path / 'data' / 'human1'}",
        *[override for override in settings if not override.startswith("task")],
        "trainer.max_epochs=1",
        "seed=3",
        f"hydra.run.dir={first}",
    )
    assert partial.status == 0, partial.stderr
    shutil.rmtree(first / ".hydra")
    (first / "metrics.json").unlink()
    second = run / "full" / "sigma0-1" / "3"
    (second / "metrics.json").unlink()

    ended = command("reproduce", *arguments)
    assert (ended.status, ended.stderr) == (0, "")
    assert (first / "metrics.csv").read_text() == curves  # the first epoch was not trained again, and all is the same
    assert "ckpt_path=" in (first / ".hydra" / "overrides.yaml").read_text()
    assert "ckpt_path=" in (second / ".hydra" / "overrides.yaml").read_text()  # finished from there, not trained again
    assert not (first / FAILED_RUN).exists()

    before = {path: path.stat().st_mtime_ns for path in run.rglob("skill.ckpt")}
    ended = command("reproduce", *arguments)
    assert (ended.status, "training" in ended.stdout) == (0, False)
    assert before == {path: path.stat().st_mtime_ns for path in run.rglob("skill.ckpt")}

    ended = command("reproduce", *arguments, "artifact.every=2")
    assert ended.status == 2
    assert "was begun with every=5; expected every=2, or another hydra.run.dir" in ended.stderr


@pytest.mark.slow
def test_study_without_test_sets_compares_the_trainings(command: Command, study_file: Path, tmp_path: Path) -> None:
    options = ["artifact=tiny", "jobs=1", "quick=true", f"hydra.run.dir={tmp_path / 'run'}"]
    content = json.loads((study_file / "artifact" / "tiny.yaml").read_text())
    del content["test_sets"], content["published"]
    (study_file / "artifact" / "tiny.yaml").write_text(json.dumps(content))
    ended = command("reproduce", "--config-dir", str(study_file), *options)
    assert (ended.status, ended.stderr) == (0, "")
    assert (ended.folder / "table.md").read_text() == (ended.folder / "summary.md").read_text()
    assert len((ended.folder / "table.csv").read_text().splitlines()) == 3
    assert not (ended.folder / "accuracy.png").exists()
