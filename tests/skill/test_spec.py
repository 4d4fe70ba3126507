"""What a skill is made of: one member for each kernel and each fitting descriptor, nothing from elsewhere."""

import copy
from pathlib import Path
from typing import Any

import jaxtyping
import pytest
import torch

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.lbd import Lbd
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType
from geoskill.io.disk_cache import DiskCache
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.message_passing import MessagePassing
from geoskill.skill.spec import FORMAT, build, describe

KERNELS = {
    "p2p": {"_target_": "geoskill.kernels.p2p.PointToPoint"},
    "p2l": {"_target_": "geoskill.kernels.p2l.PointToLine"},
    "l2l": {"_target_": "geoskill.kernels.l2l.LineToLine"},
}
DESCRIPTORS = {
    "sift": {"_target_": "geoskill.features.sift.Sift"},
    "orb": {"_target_": "geoskill.features.orb.Orb"},
    "lbd": {"_target_": "geoskill.features.lbd.Lbd"},
}
MODEL = {"_target_": "geoskill.model.bilinear.Bilinear", "_partial_": True, "hidden_dim": 4}
FEATURES = {"max_features": 9, "min_side": 33}


def described(kernels: list[str], descriptors: list[str], alternatives: int = 4) -> dict[str, Any]:
    return describe(
        {name: KERNELS[name] for name in kernels},
        {name: DESCRIPTORS[name] for name in descriptors},
        MODEL,
        FEATURES,
        alternatives,
    )


@pytest.mark.parametrize(
    ("kernels", "descriptors", "members", "extractors"),
    [
        (["p2p"], ["sift"], {"p2p_sift": {"point": "sift"}}, ["sift"]),
        # A kernel takes what fits its nodes; what no kernel takes is not extracted.
        (["p2p"], ["sift", "lbd"], {"p2p_sift": {"point": "sift"}}, ["sift"]),
        (["l2l"], ["sift", "lbd"], {"l2l_lbd": {"line": "lbd"}}, ["lbd"]),
        (
            ["p2p", "l2l"],
            ["sift", "orb", "lbd"],
            {"p2p_sift": {"point": "sift"}, "p2p_orb": {"point": "orb"}, "l2l_lbd": {"line": "lbd"}},
            ["sift", "orb", "lbd"],
        ),
        (
            ["p2l"],
            ["orb", "lbd", "sift"],
            {"p2l_orb_lbd": {"point": "orb", "line": "lbd"}, "p2l_sift_lbd": {"point": "sift", "line": "lbd"}},
            ["orb", "lbd", "sift"],
        ),
    ],
)
def test_there_is_a_member_for_every_fitting_choice(
    kernels: list[str], descriptors: list[str], members: dict[str, dict[str, str]], extractors: list[str]
) -> None:
    description = described(kernels, descriptors)
    assert {name: member["extractors"] for name, member in description["members"].items()} == members
    assert {name: KERNELS[name.split("_")[0]] for name in members} == {
        name: member["kernel"] for name, member in description["members"].items()
    }
    assert list(description["extractors"]) == extractors


def test_a_description_is_plain_and_complete() -> None:
    assert described(["p2l"], ["sift", "lbd"], alternatives=7) == {
        "format": 2,
        "extractors": {name: DESCRIPTORS[name] for name in ("sift", "lbd")},
        "members": {"p2l_sift_lbd": {"kernel": KERNELS["p2l"], "extractors": {"point": "sift", "line": "lbd"}}},
        "model": MODEL,
        "features": FEATURES,
        "alternatives": 7,
    }


@pytest.mark.parametrize(
    ("kernel", "descriptors", "message"),
    [
        ("p2p", ["lbd"], r"^kernel=p2p joins a point, and lbd describes a line; expected a descriptor of a point too"),
        ("l2l", ["sift", "orb"], r"^kernel=l2l joins a line, and sift describes a point, orb describes a point; exp"),
        ("p2l", ["sift"], r"^kernel=p2l joins a line, and sift describes a point; expected .*\(several are given as"),
    ],
)
def test_a_node_that_nothing_describes_is_refused(kernel: str, descriptors: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        described([kernel], descriptors)


def test_no_alternative_is_refused() -> None:
    with pytest.raises(InputError, match=r"^inference\.alternatives=0: expected at least 1$"):
        described(["p2p"], ["sift"], alternatives=0)


def test_what_is_built_is_what_is_described(tmp_path: Path, small_model: dict[str, Any]) -> None:
    kernels = {"p2l": KERNELS["p2l"], "p2p": KERNELS["p2p"]}
    descriptors = {
        "sift": {**DESCRIPTORS["sift"], "contrast_threshold": 0.02},
        "lbd": {**DESCRIPTORS["lbd"], "band_width": 5},
    }
    model = {**small_model, "hidden_dim": 6, "layers": 3, "shared_weights": False}
    cache = FeatureCache(DiskCache(tmp_path))
    parts = build(describe(kernels, descriptors, model, FEATURES, 5), cache)
    assert parts.alternatives == 5
    assert list(parts.members) == ["p2l_sift_lbd", "p2p_sift"]
    mixed, points = parts.members.values()
    assert type(mixed.kernel) is PointToLine
    assert type(points.kernel) is PointToPoint
    assert mixed.extractors == {NodeType.POINT: "sift", NodeType.LINE: "lbd"}
    for member, dims in ((mixed, {"point": 128, "line": 72}), (points, {"point": 128})):
        assert type(member.scorer) is MessagePassing
        assert (member.scorer.steps, len(member.scorer.layers)) == (3, 3)
        assert {str(kind): dim for kind, dim in member.scorer.motif.descriptor_dims.items()} == dims
    assert mixed.scorer is not points.scorer
    for pipeline in parts.pipelines.values():
        assert (pipeline.max_features, pipeline.min_side, pipeline.cache) == (9, 33, cache)
    sift, lbd = (pipeline.extractor for pipeline in parts.pipelines.values())
    assert isinstance(sift, Sift)
    assert isinstance(lbd, Lbd)
    assert (sift.contrast_threshold, lbd.band_width) == (0.02, 5)


def test_it_survives_a_checkpoint(tmp_path: Path) -> None:
    description = described(["p2p", "p2l"], ["sift", "orb", "lbd"])
    torch.save(description, tmp_path / "description.pt")
    back = torch.load(tmp_path / "description.pt", weights_only=True)
    assert back == description
    one, two = build(description).members, build(back).members
    assert list(one) == list(two)
    for name, member in one.items():
        assert isinstance(member.scorer, Bilinear)
        for key, weight in member.state_dict().items():
            assert torch.equal(weight, two[name].state_dict()[key])


def weights(description: dict[str, Any], member: str, seed: int) -> torch.Tensor:
    scorer = build(description, seed=seed).members[member].scorer
    return torch.nn.utils.parameters_to_vector(scorer.parameters()).detach()


def test_fresh_weights_depend_on_the_seed_and_the_name_of_the_member_only() -> None:
    alone = described(["p2p"], ["sift"])
    expected = weights(alone, "p2p_sift", seed=5)
    torch.rand(3)  # whatever was drawn before
    assert torch.equal(weights(alone, "p2p_sift", seed=5), expected)
    assert torch.equal(weights(described(["l2l", "p2p"], ["orb", "sift", "lbd"]), "p2p_sift", seed=5), expected)
    assert not torch.isclose(weights(alone, "p2p_sift", seed=6), expected).any()
    renamed = {**alone, "members": {"another": alone["members"]["p2p_sift"]}}
    assert not torch.isclose(weights(renamed, "another", seed=5), expected).any()


def test_building_leaves_the_random_numbers_of_others_alone() -> None:
    before = torch.get_rng_state()
    build(described(["p2p"], ["sift"]), seed=5)
    assert torch.equal(torch.get_rng_state(), before)


def test_building_leaves_the_description_alone() -> None:
    description = described(["p2p"], ["sift"])
    before = copy.deepcopy(description)
    build(description)
    assert description == before


FOREIGN = [
    "os.system",
    "builtins.eval",
    "torch.nn.Linear",
    "geoskill.features.cache.os.getcwd",  # what a module of this package imports is not of this package
    "geoskill.features.sift.cv2.SIFT",
    "geoskill.model.kernel_model.KernelModel",
    "geoskill.nowhere.Sift",
    "geoskill.features.sift.Orb",
    "geoskillful.Sift",
    "geoskill.Skill",
    "",
]


@pytest.mark.parametrize("target", FOREIGN)
@pytest.mark.parametrize("part", ["extractor", "kernel", "model"])
def test_parts_from_elsewhere_are_refused(part: str, target: str) -> None:
    description = copy.deepcopy(described(["p2p"], ["sift"]))
    places = {
        "extractor": description["extractors"]["sift"],
        "kernel": description["members"]["p2p_sift"]["kernel"],
        "model": description["model"],
    }
    places[part]["_target_"] = target
    with pytest.raises(InputError, match=rf"^the skill's part '{target}' is no \w+ of this package; expected geoskill"):
        build(description)


def test_parts_of_this_package_in_a_wrong_place_are_refused() -> None:
    description = copy.deepcopy(described(["p2p"], ["sift"]))
    description["extractors"]["sift"]["_target_"] = KERNELS["p2p"]["_target_"]
    with pytest.raises(InputError, match="is no FeatureExtractor of this package"):
        build(description)


def test_arguments_are_values_and_not_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # it would refuse the value, which comes too late
    description = copy.deepcopy(described(["p2p"], ["sift"]))
    left = tmp_path / "left"
    call = {"_target_": "pathlib.Path.touch", "_args_": [str(left)]}
    description["extractors"]["sift"]["contrast_threshold"] = call
    extractor = build(description).pipelines["sift"].extractor
    assert isinstance(extractor, Sift)
    assert extractor.contrast_threshold == call
    assert not left.exists()


def test_an_argument_that_a_part_does_not_take_is_named() -> None:
    with pytest.raises(InputError, match=r"^geoskill\.features\.sift\.Sift: .*'contrast'"):
        describe(
            {"p2p": KERNELS["p2p"]}, {"sift": {**DESCRIPTORS["sift"], "contrast": 1.0}}, MODEL, FEATURES, alternatives=1
        )


@pytest.mark.parametrize("number", [0, FORMAT + 1, None])
def test_another_format_is_refused(number: int | None) -> None:
    description = {**described(["p2p"], ["sift"]), "format": number}
    with pytest.raises(InputError, match=rf"^the skill's format is {number}; expected {FORMAT}$"):
        build(description)
