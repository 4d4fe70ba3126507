"""The specification of a skill: planned from names, stored as plain values, built without anything from elsewhere."""

import copy
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.config import BilinearConfig, FeaturesConfig, MessagePassingConfig
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
from geoskill.skill.build import build_skill
from geoskill.skill.plan import plan_skill
from geoskill.skill.spec import FORMAT, MemberSpec, Part, SkillSpec

FEATURES = FeaturesConfig(max_features=9, min_side=33, color=0.0)
MODEL = {"name": "bilinear", "hidden_dim": 4}


def planned(kernel: object, descriptor: object, model: object = MODEL, top_k: int = 4) -> SkillSpec:
    return plan_skill(kernel, descriptor, model, FEATURES, top_k)


@pytest.mark.parametrize(
    ("kernels", "descriptors", "members", "extractors"),
    [
        (["p2p"], ["sift"], {"p2p_sift": {"point": "sift"}}, ["sift"]),
        ("p2p", "sift", {"p2p_sift": {"point": "sift"}}, ["sift"]),
        ({"p2p": {}}, {"sift": None}, {"p2p_sift": {"point": "sift"}}, ["sift"]),
        # A kernel takes what fits its nodes; what no kernel takes is not extracted.
        (["p2p"], ["sift", "lbd"], {"p2p_sift": {"point": "sift"}}, ["sift"]),
        (["l2l"], ["sift", "lbd"], {"l2l_lbd": {"line": "lbd"}}, ["lbd"]),
        ("p2p_l2l", ["sift", "lbd"], {"p2p_sift": {"point": "sift"}, "l2l_lbd": {"line": "lbd"}}, ["sift", "lbd"]),
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
def test_plan_has_a_member_for_every_fitting_choice(
    kernels: object, descriptors: object, members: dict[str, dict[str, str]], extractors: list[str]
) -> None:
    spec = planned(kernels, descriptors)
    assert {name: dict(member.extractors) for name, member in spec.members.items()} == members
    assert list(spec.members) == list(members)
    assert {name: member.kernel.name for name, member in spec.members.items()} == {
        name: name.split("_")[0] for name in members
    }
    assert list(spec.extractors) == extractors


SIFT = {"name": "sift", "package": "geoskill", "arguments": {"contrast_threshold": 0.01, "root": False}}
LBD = {"name": "lbd", "package": "geoskill", "arguments": {"min_length_ratio": 0.015, "band_width": 7}}
PLAIN = {
    "format": 5,
    "extractors": {"sift": SIFT, "lbd": LBD},
    "members": {
        "p2l_sift_lbd": {
            "kernel": {"name": "p2l", "package": "geoskill", "arguments": {}},
            "extractors": {"point": "sift", "line": "lbd"},
        }
    },
    "model": {"name": "bilinear", "package": "geoskill", "arguments": {"hidden_dim": 4}},
    "features": {"max_features": 9, "min_side": 33, "max_side": 720, "color": 0.0},
    "top_k": 7,
}


def test_specification_as_plain_values_is_complete() -> None:
    """With the defaults of all arguments, so that other defaults in later versions change nothing."""
    spec = planned(["p2l"], ["sift", "lbd"], top_k=7)
    assert spec.as_plain() == PLAIN
    assert SkillSpec.from_plain(PLAIN) == spec
    assert SkillSpec.from_plain(copy.deepcopy(PLAIN)).as_plain() == PLAIN


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ("bilinear", {"hidden_dim": 64}),
        ({"name": "bilinear", "hidden_dim": 8}, {"hidden_dim": 8}),
        (BilinearConfig(hidden_dim=8), {"hidden_dim": 8}),
        ("prototypes", {"prototypes": 2048, "components": 16}),
        (MessagePassingConfig(), {"hidden_dim": 32, "layers": 3, "cascade": 1024, "precision": "float32"}),
        ({"name": "message_passing", "prototypes": None}, {"hidden_dim": 32, "prototypes": None}),
    ],
)
def test_plan_completes_the_arguments_of_the_network(model: object, expected: Mapping[str, object]) -> None:
    part = planned("p2p", "sift", model).model
    assert part.package == "geoskill"
    assert {key: part.arguments[key] for key in expected} == expected


@pytest.mark.parametrize(
    ("kernel", "descriptors", "message"),
    [
        ("p2p", ["lbd"], r"^kernel=p2p joins a point, and lbd describes a line; expected a descriptor of a point too"),
        ("l2l", ["sift", "orb"], r"^kernel=l2l joins a line, and sift describes a point, orb describes a point; exp"),
        ("p2l", ["sift"], r"^kernel=p2l joins a line, and sift describes a point; expected .*\(several are given as"),
        ("p2q", ["sift"], r"^kernel=p2q: no such kernel; expected one of .*p2p"),
        ("p2p", ["surf"], r"^descriptor=surf: no such descriptor; expected one of .*sift"),
        ("p2p_p2q", "sift", r"^kernel=p2p_p2q: no such kernel"),
        ([], "sift", r"^kernel=\[\]: expected at least one of .*p2p"),
        ("p2p", None, r"^descriptor=None: expected at least one of .*sift"),
        (
            "p2p",
            {"sift": {"contrast": 1.0}},
            r"^descriptor=sift has no argument 'contrast'; expected contrast_",
        ),
        ("p2p", {"sift": {"root": [1]}}, r"^descriptor=sift: root is \[1\]; expected a number, text, true or false$"),
        (
            "p2l",
            {"sift": {}, "lbd": {"band_width": 4}},
            r"^band_width is 4; expected an odd number of pixels from 1 to 63",
        ),
        ({"p2p": {"sigma": 1}}, "sift", r"^kernel=p2p has no argument 'sigma'; expected no arguments$"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_plan_refuses_what_does_not_fit(kernel: object, descriptors: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        planned(kernel, descriptors)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("large", r"^model=large: no such model; expected one of bilinear, message_passing, prototypes"),
        ({"hidden_dim": 8}, r"^model=\{'hidden_dim': 8\}: expected a name, or a mapping of name and arguments$"),
        (None, r"^model=None: expected a name"),
        ({"name": "bilinear", "layers": 3}, r"^model=bilinear has no argument 'layers'; expected hidden_dim$"),
        (
            {"name": "bilinear", "hidden_dim": "8"},
            r"^hidden_dim=8: expected a whole number of at least 1 and at most 4096$",
        ),
        (
            {"name": "message_passing", "cascade": 3},
            r"^cascade=3: expected at least top_k=4, the associations",
        ),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_plan_refuses_wrong_networks(model: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        planned("p2p", "sift", model)


def test_build_makes_what_is_specified(tmp_path: Path, small_model: dict[str, Any]) -> None:
    spec = planned(
        ["p2l", "p2p"],
        {"sift": {"contrast_threshold": 0.02}, "lbd": {"band_width": 5}},
        {**small_model, "hidden_dim": 6, "layers": 3, "shared_weights": False},
    )
    cache = FeatureCache(DiskCache(tmp_path))
    components = build_skill(spec, cache)
    assert list(components.members) == ["p2l_sift_lbd", "p2p_sift"]
    mixed, points = components.members.values()
    assert type(mixed.kernel) is PointToLine
    assert type(points.kernel) is PointToPoint
    assert mixed.extractors == {NodeType.POINT: "sift", NodeType.LINE: "lbd"}
    for member, dims in ((mixed, {"point": 128, "line": 72}), (points, {"point": 128})):
        assert type(member.scorer) is MessagePassing
        assert (member.scorer.steps, len(member.scorer.layers)) == (3, 3)
        assert {str(kind): dim for kind, dim in member.scorer.motif.descriptor_dims.items()} == dims
    assert mixed.scorer is not points.scorer
    for pipeline in components.pipelines.values():
        assert (pipeline.max_features, pipeline.min_side, pipeline.cache) == (9, 33, cache)
    sift, lbd = (pipeline.extractor for pipeline in components.pipelines.values())
    assert isinstance(sift, Sift)
    assert isinstance(lbd, Lbd)
    assert (sift.contrast_threshold, lbd.band_width) == (0.02, 5)


def test_specification_survives_a_checkpoint(tmp_path: Path) -> None:
    spec = planned(["p2p", "p2l"], ["sift", "orb", "lbd"])
    torch.save(spec.as_plain(), tmp_path / "specification.pt")
    read = SkillSpec.from_plain(torch.load(tmp_path / "specification.pt", weights_only=True))
    assert read == spec
    members, read_members = build_skill(spec).members, build_skill(read).members
    assert list(members) == list(read_members)
    for name, member in members.items():
        assert isinstance(member.scorer, Bilinear)
        for key, weight in member.state_dict().items():
            assert torch.equal(weight, read_members[name].state_dict()[key])


def initial_weights(spec: SkillSpec, member: str, seed: int) -> torch.Tensor:
    scorer = build_skill(spec, seed=seed).members[member].scorer
    return torch.nn.utils.parameters_to_vector(scorer.parameters()).detach()


def test_initial_weights_depend_on_the_seed_and_the_name_of_the_member_only() -> None:
    alone = planned(["p2p"], ["sift"])
    expected = initial_weights(alone, "p2p_sift", seed=5)
    torch.rand(3)  # whatever was drawn before
    assert torch.equal(initial_weights(alone, "p2p_sift", seed=5), expected)
    ensemble = planned(["l2l", "p2p"], ["orb", "sift", "lbd"])
    assert torch.equal(initial_weights(ensemble, "p2p_sift", seed=5), expected)
    assert not torch.isclose(initial_weights(alone, "p2p_sift", seed=6), expected).any()
    renamed = replace(alone, members={"another": alone.members["p2p_sift"]})
    assert not torch.isclose(initial_weights(renamed, "another", seed=5), expected).any()


def test_build_leaves_the_random_numbers_of_others_alone() -> None:
    before = torch.get_rng_state()
    build_skill(planned(["p2p"], ["sift"]), seed=5)
    assert torch.equal(torch.get_rng_state(), before)


def test_build_leaves_the_specification_alone() -> None:
    spec = planned(["p2p"], ["sift"])
    before = copy.deepcopy(spec.as_plain())
    build_skill(spec)
    assert spec.as_plain() == before


FOREIGN = [
    "os.system",
    "builtins.eval",
    "torch.nn.Linear",
    "geoskill.features.cache.os.getcwd",
    "geoskill.features.sift.Sift",
    "geoskill.features.sift.cv2.SIFT",
    "geoskill.model.kernel_model.KernelModel",
    "Sift",
    "../sift",
    "extractor",
    "kernel",
    "scorer",
    "keypoints",
    "",
]
ENTRIES: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "descriptor": lambda plain: plain["extractors"]["sift"],
    "kernel": lambda plain: plain["members"]["p2l_sift_lbd"]["kernel"],
    "model": lambda plain: plain["model"],
}


@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("kind", ENTRIES)
def test_build_refuses_names_from_elsewhere(kind: str, name: str) -> None:
    plain = copy.deepcopy(PLAIN)
    ENTRIES[kind](plain)["name"] = name
    with pytest.raises(InputError) as caught:
        build_skill(SkillSpec.from_plain(plain))
    message = str(caught.value)
    if re.fullmatch("[a-z]+", name):
        assert message.startswith(f"{kind}={name}: no such {kind}; expected one of ")
    else:
        assert message.endswith(f".name is {name!r}; expected the name of a class or package")


def test_build_refuses_names_of_another_registry() -> None:
    plain = copy.deepcopy(PLAIN)
    plain["extractors"]["sift"]["name"] = "p2p"
    with pytest.raises(InputError, match=r"^descriptor=p2p: no such descriptor; expected one of "):
        build_skill(SkillSpec.from_plain(plain))


@pytest.mark.parametrize("kind", ENTRIES)
def test_build_names_the_package_to_install(kind: str) -> None:
    plain = copy.deepcopy(PLAIN)
    ENTRIES[kind](plain).update(name="mine", package="some-plug-in")
    message = f"^{kind}=mine: provided by the package 'some-plug-in', which is not installed here$"
    with pytest.raises(InputError, match=message):
        build_skill(SkillSpec.from_plain(plain))


@pytest.mark.parametrize("kind", ENTRIES)
def test_build_refuses_unknown_arguments(kind: str) -> None:
    plain = copy.deepcopy(PLAIN)
    ENTRIES[kind](plain)["arguments"] = {"_target_": "os.system"}
    with pytest.raises(InputError, match=rf"^{kind}=\w+ has no argument '_target_'; expected "):
        build_skill(SkillSpec.from_plain(plain))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"hidden_dim": "8"}, "hidden_dim=8: expected a whole number of at least 1 and at most 4096"),
        ({"hidden_dim": None}, "hidden_dim=null: expected a whole number of at least 1 and at most 4096"),
        ({"hidden_dim": 0}, "hidden_dim=0: expected a whole number of at least 1 and at most 4096"),
        ({"hidden_dim": 4, "layers": 2}, "model=bilinear has no argument 'layers'; expected hidden_dim"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_from_plain_refuses_arguments_that_a_network_does_not_take(arguments: dict[str, Any], message: str) -> None:
    plain = copy.deepcopy(PLAIN)
    plain["model"]["arguments"] = arguments
    with pytest.raises(InputError) as caught:
        SkillSpec.from_plain(plain)
    assert str(caught.value) == message


REMOVED = object()


def changed(*path: str, to: Any) -> dict[str, Any]:
    """Return plain values with one entry replaced, added or removed."""
    plain: dict[str, Any] = copy.deepcopy(PLAIN)
    entries = plain
    for key in path[:-1]:
        entries = entries[key]
    if to is REMOVED:
        del entries[path[-1]]
    else:
        entries[path[-1]] = to
    return plain


MAPPINGS = [
    (),
    ("extractors",),
    ("extractors", "sift"),
    ("extractors", "sift", "arguments"),
    ("members",),
    ("members", "p2l_sift_lbd"),
    ("members", "p2l_sift_lbd", "kernel"),
    ("members", "p2l_sift_lbd", "kernel", "arguments"),
    ("members", "p2l_sift_lbd", "extractors"),
    ("model",),
    ("model", "arguments"),
    ("features",),
]
CLOSED = [path for path in MAPPINGS if path and path[-1] in ("sift", "p2l_sift_lbd", "kernel", "model", "features")]
TEXTS = [
    ("extractors", "sift", "name"),
    ("extractors", "sift", "package"),
    ("members", "p2l_sift_lbd", "kernel", "name"),
    ("members", "p2l_sift_lbd", "kernel", "package"),
    ("members", "p2l_sift_lbd", "extractors", "point"),
    ("model", "name"),
    ("model", "package"),
]
WRONG = [None, 3, 0.5, True, [], ["sift"], [["sift"]], b"sift", torch.zeros(2)]


def refused(plain: object) -> str:
    with pytest.raises(InputError) as caught:
        SkillSpec.from_plain(plain)
    return str(caught.value)


@pytest.mark.parametrize("value", [*WRONG, "text", {1: 2}], ids=repr)
@pytest.mark.parametrize("path", MAPPINGS[1:], ids=".".join)
def test_from_plain_refuses_anything_but_mappings(path: tuple[str, ...], value: Any) -> None:
    where = ".".join(path)
    assert refused(changed(*path, to=value)) == f"the skill's {where} is {value!r}; expected names with values"


@pytest.mark.parametrize("value", WRONG, ids=repr)
@pytest.mark.parametrize("path", TEXTS, ids=".".join)
def test_from_plain_refuses_anything_but_text(path: tuple[str, ...], value: Any) -> None:
    assert refused(changed(*path, to=value)) == f"the skill's {'.'.join(path)} is {value!r}; expected text"


@pytest.mark.parametrize("value", [[], [1], {}, b"1", torch.zeros(1), {"_target_": "os.system"}], ids=repr)
@pytest.mark.parametrize("path", [path for path in MAPPINGS if path[-1:] == ("arguments",)], ids=".".join)
def test_from_plain_refuses_arguments_that_are_not_plain(path: tuple[str, ...], value: Any) -> None:
    where = ".".join(path)
    assert refused(changed(*path, "own", to=value)) == f"the skill's {where}.own is {value!r}; expected a plain value"


def test_skill_without_max_side_never_reduces_pictures() -> None:
    assert SkillSpec.from_plain(changed("features", "max_side", to=REMOVED)).features.max_side == 0


@pytest.mark.parametrize("path", CLOSED, ids=".".join)
def test_from_plain_refuses_missing_and_unknown_entries(path: tuple[str, ...]) -> None:
    where = ".".join(path)
    entries: Any = PLAIN
    for key in path:
        entries = entries[key]
    known = ", ".join(entries)
    for missing in entries.keys() - {"max_side"}:  # which skills of earlier versions lack
        left = ", ".join(key for key in entries if key != missing)
        assert refused(changed(*path, missing, to=REMOVED)) == f"the skill's {where} has {left}; expected {known}"
    message = f"the skill's {where} has {known}, unknown; expected {known}"
    assert refused(changed(*path, "unknown", to=1)) == message


def test_from_plain_refuses_missing_and_unknown_top_entries() -> None:
    known = ", ".join(PLAIN)
    for missing in PLAIN:
        left = ", ".join(key for key in PLAIN if key != missing)
        expected = f"the skill's specification has {left}; expected {known}"
        if missing == "format":
            expected = "the skill's format is None; expected 5 (learn it again with this version)"
        assert refused(changed(missing, to=REMOVED)) == expected
    message = f"the skill's specification has {known}, alternatives; expected {known}"
    assert refused(changed("alternatives", to=4)) == message


@pytest.mark.parametrize("value", [None, 3, "p2p", [], [PLAIN], torch.zeros(2)], ids=repr)
def test_from_plain_refuses_other_values(value: object) -> None:
    assert refused(value) == "the skill's format is None; expected 5 (learn it again with this version)"


@pytest.mark.parametrize("number", [0, 1, 2, 3, FORMAT + 1, None, "3", [3]])
def test_from_plain_refuses_other_formats_by_their_number(number: object) -> None:
    expected = f"the skill's format is {number!r}; expected {FORMAT} (learn it again with this version)"
    assert refused(changed("format", to=number)) == expected


@pytest.mark.parametrize("value", [None, 0, -1, 2.0, True, "4", [4], torch.tensor(4)], ids=repr)
def test_from_plain_refuses_wrong_top_k(value: object) -> None:
    message = refused(changed("top_k", to=value))
    assert message == f"the skill has 1 members and top_k={value!r}; expected at least 1 of each"


def test_from_plain_refuses_a_skill_without_members() -> None:
    assert refused(changed("members", to={})) == "the skill has 0 members and top_k=7; expected at least 1 of each"


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            ("features", "max_features"),
            1,
            "features: max_features=1: expected a whole number of at least 2 and at most 5000",
        ),
        (
            ("features", "max_features"),
            "9",
            "features: max_features=9: expected a whole number of at least 2 and at most 5000",
        ),
        (
            ("features", "min_side"),
            None,
            "features: min_side=null: expected a whole number of at least 0 and at most 1080",
        ),
        (("features", "color"), float("nan"), "features: color=nan: expected a number of at least 0 and at most 1000"),
        (("features", "color"), [8.0], "features: color=[8.0]: expected a number of at least 0 and at most 1000"),
        (
            ("members", "p2l_sift_lbd", "extractors", "curve"),
            "sift",
            "members.p2l_sift_lbd.extractors has 'curve'; expected point or line or plane or conic",
        ),
        (
            ("members", "p2l_sift_lbd", "extractors", "line"),
            "orb",
            "members.p2l_sift_lbd.extractors.line is 'orb'; expected one of sift, lbd",
        ),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_from_plain_refuses_wrong_values(path: tuple[str, ...], value: object, message: str) -> None:
    assert refused(changed(*path, to=value)) == f"the skill's {message}"


def test_from_plain_reads_into_named_fields() -> None:
    spec = SkillSpec.from_plain(PLAIN)
    kernel = Part("p2l", "geoskill", {})
    assert spec.members == {"p2l_sift_lbd": MemberSpec(kernel, {"point": "sift", "line": "lbd"})}
    assert spec.extractors["sift"] == Part("sift", "geoskill", {"contrast_threshold": 0.01, "root": False})
    assert (spec.features, spec.top_k) == (FEATURES, 7)
