"""Checkpoints: what they say of a skill, where it comes from, and where they lie."""

import copy
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.features.preference import FeaturePreference
from geoskill.schema import as_plain
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance, SimulatedScene, read_skill, skill_entry, write_checkpoint
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec

SCENE = SimulatedScene("sorting", 3, ScenarioConfig(actor="robot", severity=0.5))


def test_read_skill_returns_what_was_written(skill_file: Path, spec: SkillSpec, provenance: Provenance) -> None:
    stored = read_skill(skill_file)
    assert (stored.path, stored.spec, stored.provenance) == (skill_file, spec, provenance)
    assert stored.contents["epoch"] == 3
    for name, weights in stored.weights.items():
        assert weights["spans"].tolist() == [2, 4]
        for key, value in weights.items():
            assert torch.equal(value, stored.contents["state_dict"][f"members.{name}.{key}"])
    assert list(stored.weights) == list(spec.members)


@pytest.mark.parametrize("scene", [None, SCENE])
def test_provenance_survives_a_checkpoint(
    spec: SkillSpec, provenance: Provenance, tmp_path: Path, scene: SimulatedScene | None
) -> None:
    several = replace(provenance, sources=("a.mp4", "b"), scene=scene)
    write_checkpoint(tmp_path / "skill.ckpt", {"skill": skill_entry(spec, several, {}), "state_dict": {}})
    assert read_skill(tmp_path).provenance == several


def test_preferences_survive_a_checkpoint(spec: SkillSpec, provenance: Provenance, tmp_path: Path) -> None:
    pipelines = build_skill(spec).pipelines
    name, pipeline = next(iter(pipelines.items()))
    width = pipeline.descriptor_dim
    preference = FeaturePreference(
        (np.ones((2, width), np.float32), np.eye(3, width, dtype=np.float32)), np.ones((1, width), np.float32)
    )
    entry = skill_entry(spec, provenance, {**pipelines, name: pipeline.preferring(preference)})
    write_checkpoint(tmp_path / "skill.ckpt", {"skill": entry, "state_dict": {}})
    (found,) = read_skill(tmp_path).preferences.items()
    assert found[0] == name
    for array, expected in zip(
        (*found[1].groups, found[1].others), (*preference.groups, preference.others), strict=True
    ):
        np.testing.assert_array_equal(array, expected)


@pytest.mark.parametrize(
    ("preference", "message"),
    [
        ({"groups": []}, "preferences.sift has groups; expected groups, others"),
        ({"groups": "all", "others": torch.zeros(1, 4)}, "preferences.sift holds NoneType; expected float32"),
        ({"groups": [[1.0]], "others": torch.zeros(1, 4)}, "preferences.sift holds list; expected float32"),
        ({"groups": [torch.zeros(1, 4).long()], "others": torch.zeros(1, 4)}, "holds Tensor; expected float32"),
        ({"groups": [torch.zeros(1, 3)], "others": torch.zeros(1, 4)}, r"shapes \[\(1, 3\), \(1, 4\)\]; expected"),
        ({"groups": [torch.zeros(0, 4)], "others": torch.zeros(1, 4)}, "empty or not finite"),
    ],
)
def test_read_skill_refuses_other_preferences(
    checkpoint: dict[str, Any], tmp_path: Path, preference: dict[str, Any], message: str
) -> None:
    entry = {**checkpoint["skill"], "preferences": {"sift": preference}}
    write_checkpoint(tmp_path / "skill.ckpt", {**checkpoint, "skill": entry})
    with pytest.raises(InputError, match=message):
        read_skill(tmp_path)


def test_provenance_is_unfinished_unless_said_otherwise() -> None:
    provenance = Provenance(("a",), (4, 3), "2026-01-01", "0", 1)
    assert (provenance.finished, provenance.epochs, provenance.metrics, provenance.scene) == (False, (0, 0), {}, None)
    assert Provenance.from_plain(as_plain(provenance)) == provenance


def test_checkpoint_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "skill.ckpt"
    path.write_bytes(b"old")

    def save(contents: object, file: Any) -> None:
        file.write(b"half of the ne")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(torch, "save", save)
    with pytest.raises(OSError, match="No space left"):
        write_checkpoint(path, {})
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


REMOVED = object()
ROOT = ("skill", "provenance")
CASES: list[tuple[tuple[str, ...], object, str]] = [
    (("skill",), None, "the skill's entry is None; expected names with values"),
    (("skill",), "p2p", "the skill's entry is 'p2p'; expected names with values"),
    (
        ("skill", "provenance"),
        REMOVED,
        "the skill's entry has specification, preferences; expected specification, provenance, preferences",
    ),
    (
        ("skill", "specification"),
        REMOVED,
        "the skill's entry has provenance, preferences; expected specification, provenance, preferences",
    ),
    (
        ("skill", "more"),
        1,
        "the skill's entry has specification, provenance, preferences, more; expected specification, provenance,"
        " preferences",
    ),
    (
        ("skill", "specification"),
        {},
        "the skill's format is None; expected 5 (learn it again with this version)",
    ),
    (("skill", "specification", "model"), 3, "the skill's model is 3; expected names with values"),
    (("state_dict",), [1], "the skill's state_dict is [1]; expected names with values"),
    (ROOT, [], "the skill's provenance is []; expected names with values"),
    (
        (*ROOT, "metrics"),
        REMOVED,
        "the skill's provenance has sources, image_size, date, version, seed, finished, epochs, configuration, scene,"
        " choice; expected sources, image_size, date, version, seed, finished, epochs, metrics, configuration, scene,"
        " choice",
    ),
    ((*ROOT, "sources"), "a.mp4", "the skill's provenance.sources are 'a.mp4'; expected a list"),
    ((*ROOT, "sources"), [1], "the skill's provenance.sources is 1; expected text"),
    ((*ROOT, "image_size"), [160], "the skill's provenance.image_size is [160]; expected two whole numbers"),
    ((*ROOT, "image_size"), [160, 1.5], "the skill's provenance.image_size is [160, 1.5]; expected two whole numbers"),
    ((*ROOT, "image_size"), None, "the skill's provenance.image_size is None; expected two whole numbers"),
    ((*ROOT, "epochs"), [True, 2], "the skill's provenance.epochs is [True, 2]; expected two whole numbers"),
    ((*ROOT, "date"), 2026, "the skill's provenance.date is 2026; expected text"),
    ((*ROOT, "version"), None, "the skill's provenance.version is None; expected text"),
    ((*ROOT, "seed"), "7", "the skill's provenance.seed is '7'; expected a whole number"),
    ((*ROOT, "seed"), True, "the skill's provenance.seed is True; expected a whole number"),
    ((*ROOT, "finished"), 1, "the skill's provenance.finished is 1; expected true or false"),
    ((*ROOT, "metrics"), [0.5], "the skill's provenance.metrics is [0.5]; expected names with values"),
    ((*ROOT, "metrics"), {"rsw": "low"}, "the skill's provenance.metrics are {'rsw': 'low'}; expected numbers"),
    ((*ROOT, "configuration"), "a", "the skill's provenance.configuration is 'a'; expected names with values"),
    (
        (*ROOT, "configuration", "optimizer"),
        {"lr": [torch.zeros(1)]},
        "the skill's provenance.configuration holds a tensor; expected plain values",
    ),
    ((*ROOT, "scene"), "sorting", "the skill's provenance.scene is 'sorting'; expected names with values"),
    ((*ROOT, "scene", "seed"), 1.5, "the skill's provenance.scene.seed is 1.5; expected a whole number of at least 0"),
    ((*ROOT, "scene", "task"), None, "the skill's provenance.scene.task is None; expected text"),
    (
        (*ROOT, "scene", "task"),
        REMOVED,
        "the skill's provenance.scene has seed, scenario; expected task, seed, scenario",
    ),
    ((*ROOT, "scene", "scenario"), 1, "the skill's provenance.scene.scenario is 1; expected names with values"),
    (
        (*ROOT, "scene", "scenario", "severity"),
        9,
        "the skill's provenance.scene.scenario: severity=9: expected a number of at least 0 and at most 1.5",
    ),
    (
        (*ROOT, "scene", "scenario", "actor"),
        "cat",
        "the skill's provenance.scene.scenario: actor=cat: expected human or robot",
    ),
]


@pytest.mark.parametrize(("where", "value", "message"), CASES)
@pytest.mark.usefixtures("annotations_unchecked")
def test_read_skill_names_every_wrong_entry(
    checkpoint: dict[str, Any], tmp_path: Path, where: tuple[str, ...], value: object, message: str
) -> None:
    contents = copy.deepcopy(checkpoint)
    contents["skill"]["provenance"]["scene"] = as_plain(SCENE)
    entries: Any = contents
    for key in where[:-1]:
        entries = entries[key]
    if value is REMOVED:
        del entries[where[-1]]
    else:
        entries[where[-1]] = value
    path = tmp_path / "skill.ckpt"
    torch.save(contents, path)
    with pytest.raises(InputError) as caught:
        read_skill(path)
    assert str(caught.value) == f"{path}: {message}"


def test_missing_extras_of_a_checkpoint_do_no_harm(checkpoint: dict[str, Any], tmp_path: Path) -> None:
    """Names of weights that belong to no member, and values that are no weights, are left out."""
    contents = copy.deepcopy(checkpoint)
    contents["state_dict"] |= {"members.other.weight": torch.zeros(1), "members.p2p_sift.own": 3, "own": torch.zeros(1)}
    torch.save(contents, tmp_path / "skill.ckpt")
    stored, expected = read_skill(tmp_path), checkpoint["state_dict"]
    assert sum(len(weights) for weights in stored.weights.values()) == len(expected)
    Skill.load(tmp_path)


def test_home_folder_is_expanded(skill_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(skill_file.parent))
    assert read_skill("~/skill.ckpt").path == read_skill("~").path == skill_file


class Artifacts:
    """The network side of wandb: artifacts by their full name."""

    def __init__(self, folders: dict[str, Path]) -> None:
        self.folders = folders
        self.asked: list[tuple[str, str]] = []

    def __call__(self) -> "Artifacts":
        return self

    def artifact(self, name: str, type: str) -> Callable[[], str]:
        self.asked.append((name, type))
        if name not in self.folders:
            raise ValueError(f"artifact {name!r}\n  not found\n  (404)")
        folder = str(self.folders[name])

        class Artifact:
            def download(self) -> str:
                return folder

        return Artifact()  # type: ignore[return-value]


@pytest.fixture
def artifacts(skill_file: Path, monkeypatch: pytest.MonkeyPatch) -> Artifacts:
    import wandb

    fake = Artifacts(
        {"me/geoskill/skill-1a2b:latest": skill_file.parent, "me/geoskill/skill-1a2b:v0": Path("/no/such")}
    )
    monkeypatch.setattr(wandb, "Api", fake)
    return fake


def test_skill_is_fetched_from_wandb(artifacts: Artifacts, skill_file: Path) -> None:
    reference = "wandb:me/geoskill/skill-1a2b:latest"
    assert read_skill(reference).path == skill_file
    assert repr(Skill.load(reference)) == repr(Skill.load(skill_file))
    assert artifacts.asked == [("me/geoskill/skill-1a2b:latest", "skill")] * 2


@pytest.mark.parametrize(
    "name", ["", "skill", "skill:latest", "me/skill:latest", "me/geoskill/skill", "a/b/c/d:latest", "run.ckpt"]
)
def test_malformed_wandb_references_are_refused(artifacts: Artifacts, name: str) -> None:
    with pytest.raises(InputError) as caught:
        read_skill(f"wandb:{name}")
    assert str(caught.value) == f"wandb:{name}: expected wandb:ENTITY/PROJECT/NAME:ALIAS"
    assert artifacts.asked == []


def test_unreachable_wandb_artifacts_are_refused_in_a_line(artifacts: Artifacts) -> None:
    with pytest.raises(InputError) as caught:
        read_skill("wandb:me/geoskill/other:latest")
    assert str(caught.value) == (
        "wandb:me/geoskill/other:latest: cannot be fetched (artifact 'me/geoskill/other:latest' not found (404));"
        " expected the artifact of a training"
    )


def test_unreachable_wandb_server_is_refused_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import wandb

    def api() -> None:
        raise wandb.errors.CommError("connection\nrefused\n" + "x" * 1000)

    monkeypatch.setattr(wandb, "Api", api)
    with pytest.raises(InputError, match=r"^wandb:a/b/c:d: cannot be fetched \(connection refused x+\); exp") as caught:
        read_skill("wandb:a/b/c:d")
    assert len(str(caught.value)) < 300


def test_wandb_artifact_without_checkpoint_is_refused(artifacts: Artifacts) -> None:
    with pytest.raises(
        InputError, match=r"^/no/such/skill\.ckpt: no such file; expected the skill\.ckpt of a training"
    ):
        read_skill("wandb:me/geoskill/skill-1a2b:v0")
