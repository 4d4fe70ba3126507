"""Studies: their validation, their jobs, and what is not done twice."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from geoskill.cli.study import Job, Step, Study
from geoskill.errors import InputError


def study(**settings: Any) -> Study:
    node = {
        "name": "small",
        "seeds": [3, 1],
        "train": ["task=sorting"],
        "variants": {"default": [], "layers=2": ["model.layers=2", "task=screw"]},
        "test_sets": {"human": ["scenario=human"]},
        "every": 4,
    }
    return Study.from_plain({**node, **settings})


def begin(step: Step, *further: str) -> None:
    (step.folder / ".hydra").mkdir(parents=True)
    (step.folder / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump([*step.overrides, *further]))


def test_jobs_are_all_variants_with_all_seeds(tmp_path: Path) -> None:
    jobs = study().jobs(tmp_path, quick=False)
    assert [job.name for job in jobs] == ["default, seed 3", "default, seed 1", "layers=2, seed 3", "layers=2, seed 1"]
    folder = tmp_path / "layers-2" / "3"
    assert jobs[2].training == Step(
        "train",
        ("task=sorting", "model.layers=2", "task=screw", "seed=3", "threads=1", "logger=none"),
        folder,
    )
    # The task is that which was learned, the last one named.
    assert jobs[2].tests == {
        "human": Step(
            "evaluate", (f"skill={folder / 'skill.ckpt'}", "task=screw", "scenario=human", "every=4"), folder / "human"
        )
    }


def test_quick_jobs_have_one_seed_and_few_frames(tmp_path: Path) -> None:
    jobs = study().jobs(tmp_path, quick=True)
    assert [job.name for job in jobs] == ["default, seed 3", "layers=2, seed 3"]
    assert "trainer.max_epochs=2" in jobs[0].training.overrides
    assert jobs[0].tests["human"].overrides[-1] == "every=10"


def test_a_video_is_not_named_to_the_evaluation(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    jobs = study(train=["task=video", f"task.path={tmp_path}/a"], data=str(tmp_path)).jobs(tmp_path, quick=False)
    assert not [override for override in jobs[0].tests["human"].overrides if override.startswith("task=")]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"rows": {}}, "artifact.rows: there is no such key; expected one of name, seeds, variants"),
        ({"seeds": []}, "artifact.seeds is empty; expected at least one"),
        ({"variants": {}}, "artifact.variants is empty; expected at least one"),
        ({"variants": {"../up": []}}, "artifact: '../up' cannot be the name of a folder"),
        ({"variants": {"a=1": [], "a-1": []}}, "artifact.variants: two names make the same folder"),
        ({"data": None}, "artifact.data is not set"),
        ({"data": "here", "train": ["task.path=here/no"]}, "artifact.data=here: has no folder no; expected one"),
    ],
)
def test_from_plain_refuses(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        study(**settings)
    assert str(error.value).startswith(message)


def test_from_plain_needs_a_name() -> None:
    with pytest.raises(InputError, match=r"artifact\.name is not set"):
        Study.from_plain({"seeds": [0], "variants": {"default": []}})


def test_a_step_is_complete_with_its_metrics(tmp_path: Path) -> None:
    job = study().jobs(tmp_path, quick=False)[0]
    assert not job.is_complete()
    begin(job.training, "ckpt_path=skill.ckpt")
    assert not job.training.is_complete()
    job.training.metrics_path.write_text('{"steps": 4.0, "rsw": 0.1, "frames": 20}')
    assert job.training.is_complete()
    assert not job.is_complete()
    begin(job.tests["human"])
    job.tests["human"].metrics_path.write_text('{"frames": 5}')
    assert job.is_complete()
    assert job.scores(("steps", "rsw", "objective")) == {"seed": 3, "steps": 4.0, "rsw": 0.1, "human": {"frames": 5}}


def test_results_of_other_settings_are_refused(tmp_path: Path) -> None:
    begin(study().jobs(tmp_path, quick=False)[0].tests["human"])
    changed = study(every=2).jobs(tmp_path, quick=False)[0]
    with pytest.raises(InputError, match=r"was begun with every=4; expected every=2, or another hydra\.run\.dir"):
        changed.is_complete()


def test_the_skill_may_lie_elsewhere(tmp_path: Path) -> None:
    begin(study().jobs(tmp_path / "old", quick=False)[0].tests["human"])
    (tmp_path / "old").rename(tmp_path / "new")
    study().jobs(tmp_path / "new", quick=False)[0].is_complete()


def fake_calls(monkeypatch: pytest.MonkeyPatch, refuse: str | None) -> list[tuple[str, ...]]:
    calls: list[tuple[str, ...]] = []

    def call(step: Step, *further: str) -> None:
        calls.append((step.command, *further))
        if further and refuse is not None:
            raise InputError(refuse)
        step.folder.mkdir(parents=True, exist_ok=True)
        step.metrics_path.write_text("{}")

    monkeypatch.setattr(Step, "_call", call)
    return calls


def job_with_checkpoint(folder: Path) -> Job:
    job = study().jobs(folder, quick=False)[0]
    job.training.folder.mkdir(parents=True)
    (job.training.folder / "skill.ckpt").touch()
    return job


def test_a_killed_training_goes_on_from_its_checkpoint(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls, job = fake_calls(monkeypatch, None), job_with_checkpoint(tmp_path)
    job.perform()
    assert calls == [("train", f"ckpt_path={job.training.folder / 'skill.ckpt'}"), ("evaluate",)]
    job.perform()
    assert len(calls) == 2


def test_a_refused_checkpoint_is_trained_again(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    calls, job = fake_calls(monkeypatch, "has all of its 2 epochs"), job_with_checkpoint(tmp_path)
    job.perform()
    assert [call[0] for call in calls] == ["train", "train", "evaluate"]
    assert calls[1] == ("train",)


@pytest.mark.parametrize("content", ["", "{", "[]"])
def test_a_step_with_damaged_results_is_done_again(tmp_path: Path, content: str) -> None:
    (step,) = (job.training for job in study(seeds=[1], variants={"default": []}).jobs(tmp_path, quick=False))
    begin(step)
    step.metrics_path.write_text("{}")
    assert step.is_complete()
    step.metrics_path.write_text(content)
    assert not step.is_complete()
