"""Weights of a checkpoint from anybody: finite, and of the shapes of its specification, before these are built."""

import copy
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.errors import InputError
from geoskill.skill.checkpoint import read_skill
from geoskill.skill.skill import Skill

STATISTICS = ("spans", "beta", "node_order", "reference_margin")


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_every_weight_and_statistic_must_be_finite(checkpoint: dict[str, Any], tmp_path: Path, value: float) -> None:
    path = tmp_path / "skill.ckpt"
    floats = [key for key, weight in checkpoint["state_dict"].items() if weight.is_floating_point() and weight.numel()]
    assert any(".scorer." in key for key in floats)
    assert any(key.endswith("beta") for key in floats)
    for key in floats:
        contents = copy.deepcopy(checkpoint)
        contents["state_dict"][key].view(-1)[-1] = value
        torch.save(contents, path)
        with pytest.raises(InputError) as caught:
            read_skill(path)
        own = key.removeprefix("members.")
        message = f"{path}: {own} is not finite; expected the weights of a training that did not diverge"
        assert str(caught.value) == message


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"node_order": torch.zeros(7)}, r"p2p_sift.node_order is \[7\]; expected 128 numbers, or none"),
        ({"node_order": torch.zeros(1, 128)}, r"p2p_sift.node_order is \[1, 128\]; expected 128 numbers, or none"),
        ({"spans": torch.zeros(3)}, r"p2p_sift has spans \[3\] and beta \[2\]; expected as many"),
        ({"spans": torch.zeros(2, 1), "beta": torch.zeros(2, 1)}, r"p2p_sift has spans \[2, 1\] and beta \[2, 1\]"),
        ({"settling_values": torch.zeros(2)}, r"p2p_sift.settling_values is \[2\]; expected 3 numbers, or none"),
        ({"settling_values": torch.full((3,), 7.0)}, r"p2p_sift.settling_values begins with \[7.0\]; expected a share"),
        ({"level_values": torch.zeros(2)}, r"p2p_sift.level_values is \[2\]; expected a number, or none"),
        ({"reference_margin": torch.zeros(2)}, r"p2p_sift.reference_margin is \[2\]; expected \[\]"),
        ({"scorer.more": torch.zeros(2)}, r"p2p_sift has \['scorer.more'\] and lacks \[\]"),
    ],
)
def test_other_weights_are_refused(
    checkpoint: dict[str, Any], tmp_path: Path, change: dict[str, torch.Tensor], reason: str
) -> None:
    contents = copy.deepcopy(checkpoint)
    contents["state_dict"] |= {f"members.p2p_sift.{name}": value for name, value in change.items()}
    path = tmp_path / "skill.ckpt"
    torch.save(contents, path)
    with pytest.raises(InputError, match=rf"^{path}: its weights do not fit its specification \({reason}"):
        Skill.load(path)


def widest(specification: dict[str, Any]) -> None:
    specification["model"]["arguments"] |= {"hidden_dim": 4096, "layers": 64, "shared_weights": False}


def many_members(specification: dict[str, Any]) -> None:
    member = specification["members"]["p2p_sift"]
    specification["members"] |= {f"p2p_{number}": member for number in range(60)}
    specification["model"]["arguments"] |= {"prototypes": 100_000}


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is in kilobytes on Linux")
@pytest.mark.parametrize("enlarge", [widest, many_members])
def test_what_does_not_fit_is_not_built(
    checkpoint: dict[str, Any], tmp_path: Path, enlarge: Callable[[dict[str, Any]], None]
) -> None:
    """These would take 13 and 11 GB."""
    contents = copy.deepcopy(checkpoint)
    enlarge(contents["skill"]["specification"])
    path = tmp_path / "skill.ckpt"
    torch.save(contents, path)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(InputError, match=rf"^{path}: its weights do not fit its specification \(.+\)$"):
        Skill.load(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000


@pytest.mark.parametrize(
    ("where", "value", "message"),
    [
        (
            ("model", "arguments", "hidden_dim"),
            20_000,
            "hidden_dim=20000: expected a whole number of at least 1 and at",
        ),
        (("features", "min_side"), 10**6, "features: min_side=1000000: expected a whole number of at least 0 and at"),
        (("features", "max_features"), 10**6, "features: max_features=1000000: expected a whole number of at least 2"),
        (("top_k",), 10**6, "the skill's top_k is 1000000; expected at most 1000"),
        (("extractors", "lbd", "arguments", "band_width"), 10**9 + 1, "skill.ckpt: band_width is 1000000001; expected"),
        (("members", "a.b"), {}, "the skill's members has 'a.b'; expected small letters, digits and underscores"),
        (("extractors",), {f"e{number}": {} for number in range(65)}, "the skill has 65 extractors; expected at most"),
    ],
)
def test_sizes_have_bounds(
    checkpoint: dict[str, Any], tmp_path: Path, where: tuple[str, ...], value: object, message: str
) -> None:
    contents = copy.deepcopy(checkpoint)
    entries = contents["skill"]["specification"]
    for key in where[:-1]:
        entries = entries[key]
    entries[where[-1]] = value
    path = tmp_path / "skill.ckpt"
    torch.save(contents, path)
    with pytest.raises(InputError) as caught:
        Skill.load(path)
    assert message in str(caught.value)


def test_checkpoint_without_the_level_of_scores_is_read_as_before(checkpoint: dict[str, Any], tmp_path: Path) -> None:
    path, contents = tmp_path / "skill.ckpt", copy.deepcopy(checkpoint)
    for name in ("p2p_sift", "p2l_sift_lbd"):
        contents["state_dict"].pop(f"members.{name}.level_values")
    torch.save(contents, path)
    assert all(member.reference_level is None for member in Skill.load(path).members.values())
