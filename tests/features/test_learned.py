"""Pretrained features with random weights, through the code that loads published ones."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.features.learned_weights import DIGEST
from geoskill.plugins import EXTRACTORS
from geoskill.skill.plan import plan_skill
from geoskill.skill.spec import SkillSpec
from geoskill.testing import check_extractor

kornia = pytest.importorskip("kornia")
NAMES = ("aliked", "disk", "xfeat")


@pytest.fixture(autouse=True)
def store(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GEOSKILL_WEIGHTS", str(tmp_path / "weights"))
    return tmp_path / "weights"


def random_state(name: str) -> dict[str, Any]:
    """As the authors have it in their files."""
    import kornia.feature

    with torch.random.fork_rng():
        torch.manual_seed(3)
        if name == "disk":
            return {"extractor": kornia.feature.DISK().state_dict()}
        network = kornia.feature.XFeat().net if name == "xfeat" else kornia.feature.ALIKED()
        return dict(network.state_dict())


def weights_of(name: str, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    torch.save(random_state(name), folder / f"{name}.pt")
    return folder / f"{name}.pt"


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_contract(name: str, tmp_path: Path) -> None:
    check_extractor(EXTRACTORS.get(name)(weights=str(weights_of(name, tmp_path))))


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_positions_follow_the_picture(name: str, tmp_path: Path) -> None:
    """Of a picture that is moved by 32 pixels, which networks halve without a rest, keypoints are 32 pixels farther."""
    extractor = EXTRACTORS.get(name)(weights=str(weights_of(name, tmp_path)))
    noise = np.random.default_rng(0).integers(0, 256, (10, 14)).astype(np.uint8)
    picture = np.kron(noise, np.ones((16, 16), np.uint8))
    moved = np.roll(picture, 32, axis=1)
    first, second = extractor.extract(picture), extractor.extract(moved)
    inside = (first.geometry[:, 0] > 64) & (first.geometry[:, 0] < picture.shape[1] - 96)
    inside &= (first.geometry[:, 1] > 48) & (first.geometry[:, 1] < picture.shape[0] - 48)
    assert inside.sum() >= 3
    distance = np.linalg.norm(first.geometry[inside][:, None] + (32, 0) - second.geometry[None], axis=2).min(axis=1)
    assert np.median(distance) < 1.0


def test_skill_keeps_a_digest_and_the_file(store: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.pth"
    path.write_bytes(b"weights")
    spec = plan_skill("p2p", {"disk": {"weights": str(path)}}, {"name": "bilinear"}, FeaturesConfig(), 5)
    weights = spec.extractors["disk"].arguments["weights"]
    assert isinstance(weights, str)
    assert DIGEST.fullmatch(weights)
    assert (store / f"disk-{weights.removeprefix('sha256:')}.pt").read_bytes() == b"weights"
    assert str(path) not in str(spec.as_plain())
    assert SkillSpec.from_plain(spec.as_plain()) == spec
    hostile = spec.as_plain()
    hostile["extractors"]["disk"]["arguments"]["weights"] = str(path)
    with pytest.raises(InputError, match=r"extractors\.disk\.arguments\.weights is .*; expected a digest"):
        SkillSpec.from_plain(hostile)


def test_files_that_are_refused(store: Path, tmp_path: Path) -> None:
    picture = np.kron(np.eye(8, dtype=np.uint8) * 200, np.ones((8, 8), np.uint8))
    extractor_class = EXTRACTORS.get("xfeat")
    with pytest.raises(InputError, match=r"^descriptor\.xfeat\.weights=/no/such: cannot be read .*; expected a file$"):
        extractor_class(weights="/no/such")
    (tmp_path / "text").write_text("no weights")
    with pytest.raises(InputError, match=r"are no weights of XFeat .*; expected them"):
        extractor_class(weights=str(tmp_path / "text")).extract(picture)
    torch.save({"a": torch.zeros(1)}, tmp_path / "other.pt")
    with pytest.raises(InputError, match=r"are no weights of XFeat"):
        extractor_class(weights=str(tmp_path / "other.pt")).extract(picture)
    with pytest.raises(InputError, match=r"^descriptor=xfeat: .* is not there; expected the weights that the skill"):
        extractor_class(weights="sha256:" + "0" * 64).extract(picture)


def test_weights_that_cannot_be_downloaded(monkeypatch: pytest.MonkeyPatch, store: Path) -> None:
    picture = np.kron(np.eye(8, dtype=np.uint8) * 200, np.ones((8, 8), np.uint8))
    extractor = EXTRACTORS.get("xfeat")()
    monkeypatch.setattr("geoskill.features.xfeat.URLS", ("http://127.0.0.1:9/xfeat.pt",))
    with pytest.raises(InputError, match=r"cannot be downloaded from http://127.* expected a network, or the file as"):
        extractor.extract(picture)
    assert list(store.iterdir()) == []
    published = weights_of("xfeat", store)
    monkeypatch.setattr("geoskill.features.xfeat.URLS", (published.rename(store / "served").as_uri(),))
    assert len(extractor.extract(picture)) >= 0
    assert (store / "xfeat.pt").is_file()


@pytest.mark.slow
def test_learning_with_pretrained_features(
    command: Callable[..., Any], tiny: list[str], tmp_path: Path, demonstration_folder: Path
) -> None:
    given = ["descriptor=xfeat", f"descriptor.xfeat.weights={weights_of('xfeat', tmp_path / 'mine (1)')}"]
    trained = command("train", *tiny, *given, "features.min_side=240", f"hydra.run.dir={tmp_path / 'run'}")
    assert trained.status == 0, trained.stderr
    answered = command(
        "infer", f"skill={trained.folder}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path / 'b'}"
    )
    assert answered.status == 0, answered.stderr
