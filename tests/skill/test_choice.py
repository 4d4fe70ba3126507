"""What ``kernel=auto`` may keep, and how a choice is stored."""

from typing import Any

import pytest

from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.skill.choice import CANDIDATES, Choice, is_auto, only, plan_candidates

CHOICE = Choice(("p2p_sift",), {"l2l_lbd": "says nothing"})


@pytest.mark.parametrize("kernel", ["auto", ["auto"], {"auto": {}}, {"auto": None}])
def test_auto_is_recognized(kernel: Any) -> None:
    assert is_auto(kernel)


@pytest.mark.parametrize("kernel", ["p2p", "p2p_l2l", ["p2p", "l2l"], {"par": {}}, None, [], 3])
def test_named_kernels_are_not_auto(kernel: Any) -> None:
    assert not is_auto(kernel)


@pytest.mark.parametrize(
    ("descriptor", "members"),
    [
        ("sift", ["p2p_sift"]),
        ("lbd", ["l2l_lbd", "par_lbd"]),
        (["orb", "lbd"], ["p2p_orb", "l2l_lbd", "p2l_orb_lbd", "par_lbd"]),
        (["sift", "orb"], ["p2p_sift", "p2p_orb"]),
    ],
)
def test_candidates_are_what_the_descriptors_allow(descriptor: Any, members: list[str]) -> None:
    spec = plan_candidates(descriptor, "bilinear", FeaturesConfig(), 4)
    assert list(spec.members) == members


def test_only_keeps_the_extractors_that_are_used() -> None:
    spec = plan_candidates(["sift", "lbd"], "bilinear", FeaturesConfig(), 4)
    assert len(spec.members) == len(CANDIDATES)
    assert list(only(spec, ("l2l_lbd",)).extractors) == ["lbd"]
    assert list(only(spec, ("p2l_sift_lbd",)).extractors) == ["sift", "lbd"]


def test_choice_reads_back_from_plain_values() -> None:
    assert CHOICE.as_plain() == {"kept": ["p2p_sift"], "dropped": {"l2l_lbd": "says nothing"}}
    assert Choice.from_plain(CHOICE.as_plain(), "choice") == CHOICE
    assert CHOICE.statements() == ["kept: p2p_sift", "dropped l2l_lbd: says nothing"]


@pytest.mark.parametrize(
    "value",
    [
        3,
        {},
        {"kept": []},
        {"kept": "a", "dropped": {}},
        {"kept": [1], "dropped": {}},
        {"kept": [], "dropped": {"a": 2}},
    ],
)
def test_choice_refuses_other_values(value: Any) -> None:
    with pytest.raises(InputError, match=r"^the skill's choice"):
        Choice.from_plain(value, "choice")
