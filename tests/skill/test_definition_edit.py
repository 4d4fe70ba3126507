"""Tests of edited definitions of an untrained skill: what is obeyed, and what is refused."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.skill.build import SkillComponents
from geoskill.skill.definition import TaskDefinition
from geoskill.skill.definition_edit import EDITING, read_edit
from geoskill.skill.pin import MIN_SIMILARITY, Pin
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter

POINT = NodeType.POINT


@pytest.fixture(scope="session")
def trained_components(checkpoint: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> SkillComponents:
    """Of the fixture's skill: p2p_sift, whose goal is known, and p2l_sift_lbd, whose is not."""
    path = tmp_path_factory.mktemp("skill") / "skill.ckpt"
    torch.save(checkpoint, path)
    skill = Skill.load(path)
    ends = torch.tensor([[60.0, 50.0]])
    own = torch.eye(skill.pipelines["sift"].descriptor_dim)[:1]
    nodes = [(own, ends), (own, ends + 20)]
    member = skill.members["p2p_sift"]
    member.goal.fit(torch.tensor([True, False]), nodes, {POINT: nodes[1]}, {POINT: nodes[0]}, {POINT: 0.5})
    member.goal.set_tolerance(2.50049)
    return SkillComponents(dict(skill.members), dict(skill.pipelines))


@pytest.fixture(scope="session")
def components(trained_components: SkillComponents) -> SkillComponents:
    return trained_components


@pytest.fixture(scope="session")
def text(components: SkillComponents, demonstration_frames: Sequence[np.ndarray], spec: Any, provenance: Any) -> str:
    """The definition as a run writes it."""
    skill = Skill(components, spec, provenance)
    definition = TaskDefinition(skill.members)
    for number in (0, 5, 10):
        frame = demonstration_frames[number]
        result = skill.infer(frame)
        definition.add(number, result, frame)
        if number == 0:  # as if another one had been the best in some frames
            scored, best = skill.observe(frame).members["p2p_sift"], result.associations[0]
            own = Pin(1, [result.features["sift"].descriptors[node.feature] for node in best.nodes])
            others = ~own.allows(scored.member.kernel, scored.graph)
            (other,) = scored.associations([int(others.nonzero()[0])])
            definition.add(1, replace(result, associations=(other,)), frame)
    plain = {"source": "tiles.mp4", **definition.as_dict()}
    return EDITING + yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=120)


@pytest.fixture
def original(text: str, tmp_path: Path) -> Path:
    path = tmp_path / "skill.yaml"
    path.write_text(text)
    return path


def edited(original: Path, *changes: tuple[str, str]) -> Path:
    """Write a copy in which the first of these texts are replaced."""
    text = original.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    path = original.with_name("edited.yaml")
    path.write_text(text)
    return path


def without_member(text: str, name: str) -> str:
    plain = yaml.safe_load(text)
    del plain["members"][name]
    return yaml.safe_dump(plain, sort_keys=False)


def test_unchanged_definition_changes_nothing(components: SkillComponents, original: Path) -> None:
    edit = read_edit(edited(original), components, original)
    assert (edit.members, edit.tolerances, edit.pins) == (("p2p_sift", "p2l_sift_lbd"), {}, {})


def test_tolerance_is_that_of_the_edit(components: SkillComponents, original: Path, spec: Any) -> None:
    edit = read_edit(edited(original, ("goal_tolerance: 2.5", "goal_tolerance: 7")), components, original)
    assert edit.tolerances == {"p2p_sift": 7.0}
    changed, _ = edit.applied(components, spec)
    assert float(changed.members["p2p_sift"].goal.tolerance) == 7.0
    assert float(components.members["p2p_sift"].goal.tolerance) == pytest.approx(2.50049)


def test_member_is_left_out_with_what_only_it_needs(
    components: SkillComponents, original: Path, text: str, spec: Any
) -> None:
    path = original.with_name("edited.yaml")
    path.write_text(without_member(text, "p2l_sift_lbd"))
    edit = read_edit(path, components, original)
    changed, smaller = edit.applied(components, spec)
    assert list(changed.members) == list(smaller.members) == ["p2p_sift"]
    assert list(changed.pipelines) == list(smaller.extractors) == ["sift"]
    assert list(spec.members) == ["p2p_sift", "p2l_sift_lbd"]


def test_pinned_association_is_the_only_one_selected(
    components: SkillComponents, original: Path, spec: Any, provenance: Any, demonstration_frames: Sequence[np.ndarray]
) -> None:
    """The last one listed, which the scores prefer in no frame that has the others."""
    listed = yaml.safe_load(original.read_text())["members"]["p2p_sift"]["associations"]
    assert len(listed) >= 2
    edit = read_edit(edited(original, ("pin: null", f"pin: {len(listed)}")), components, original)
    pinned, free = (Skill(components, spec, provenance, pins) for pins in (edit.pins, None))
    frame = demonstration_frames[0]
    own, others = pinned.infer(frame), free.infer(frame)
    chosen = [association for association in own.associations if association.member == "p2p_sift"]
    xy = {tuple(node["xy"]) for node in listed[-1]["nodes"]}
    assert xy in [{tuple(round(x, 3) for x in node.coordinates) for node in own.nodes} for own in chosen]
    descriptors = own.features["sift"].descriptors
    for association in chosen:
        similar = [descriptors[node.feature] @ edit.pins["p2p_sift"].descriptors[0] for node in association.nodes]
        assert max(similar) >= MIN_SIMILARITY
    counts = [sum(own.member == "p2p_sift" for own in result.associations) for result in (own, others)]
    assert 1 <= counts[0] < counts[1]
    # What is said of the others is what is said without a pin.
    rest = [[own for own in result.associations if own.member != "p2p_sift"] for result in (own, others)]
    assert rest[0] == rest[1]
    with pytest.raises(InputError, match="pinned associations, of p2p_sift"):
        pinned.save(original.with_name("skill.ckpt"))


def test_pinned_association_that_is_not_visible(
    components: SkillComponents, original: Path, spec: Any, provenance: Any, demonstration_frames: Sequence[np.ndarray]
) -> None:
    edit = read_edit(edited(original, ("pin: null", "pin: 1")), components, original)
    skill = Skill(components, spec, provenance, edit.pins)
    other = np.random.default_rng(0).integers(0, 255, (12, 16, 3)).repeat(10, axis=0).repeat(10, axis=1)
    for infer in (skill.infer, TemporalFilter(skill).infer):
        result = infer(other.astype(np.uint8))
        assert result.reasons["p2p_sift"] == "the pinned association is not visible"
        assert not [own for own in result.associations if own.member == "p2p_sift"]


BAD_EDITS = {
    "unknown member": (("  p2p_sift:\n", "  p2p_orb:\n"), "the skill has no member 'p2p_orb'"),
    "twice": (("  p2l_sift_lbd:\n", "  p2p_sift:\n"), "'p2p_sift' occurs twice"),
    "kernel": (("kernel: p2p", "kernel: l2l"), "members.p2p_sift.kernel is 'l2l'; expected 'p2p'"),
    "descriptor": (("descriptor: sift", "descriptor: orb"), "members.p2p_sift.descriptor is 'orb'; expected 'sift'"),
    "rows": (("[p2p_sift.x, p2p_sift.y]", "[p2p_sift.x]"), "members.p2p_sift.error_rows is"),
    "unit": (("unit: px", "unit: mm"), "members.p2p_sift.unit is 'mm'; expected 'px'"),
    "meaning": (("meaning: one point", "meaning: no point"), "members.p2p_sift.meaning is 'no point comes"),
    "sentence": (("One point comes", "No point comes"), "members.p2p_sift.sentence is"),
    "source": (("source: tiles.mp4", "source: /etc/passwd"), ": source is '/etc/passwd'; expected 'tiles.mp4'"),
    "new key": (("source: tiles.mp4", "sauce: 1\nsource: tiles.mp4"), ": sauce is no entry of it"),
    "new key of a member": (
        ("    kernel: p2p", "    color: red\n    kernel: p2p"),
        "members.p2p_sift.color is no entry",
    ),
    "confidence": (("mean_confidence: 0", "mean_confidence: 1"), "mean_confidence is 1"),
    "share": (("share: 0.75", "share: 1.0"), r"members.p2p_sift.associations\[1\].share is 1.0; expected 0.75"),
    "node": (("role: moving", "role: resting"), r"associations\[1\].nodes\[1\].role is 'resting'; expected 'moving'"),
    "missing": (("    unit: px\n", ""), "members.p2p_sift.unit is missing"),
    "tolerance of nothing": (("tolerance: null", "tolerance: 3"), "members.p2l_sift_lbd.goal_tolerance is 3; expected"),
    "no tolerance": (("tolerance: 2.5", "tolerance: null"), "members.p2p_sift.goal_tolerance is null; expected a num"),
    "zero tolerance": (("tolerance: 2.5", "tolerance: 0"), "goal_tolerance is 0; expected a number above 0"),
    "negative tolerance": (("tolerance: 2.5", "tolerance: -2.5"), "goal_tolerance is -2.5"),
    "endless tolerance": (("tolerance: 2.5", "tolerance: .inf"), ".inf is no finite number"),
    "huge tolerance": (("tolerance: 2.5", "tolerance: 9999999"), "up to 1e.06 px"),
    "words": (("tolerance: 2.5", "tolerance: small"), "goal_tolerance is 'small'"),
    "yes": (("tolerance: 2.5", "tolerance: yes"), "goal_tolerance is True"),
    "pin of none": (
        ("pin: null", "pin: 0"),
        "members.p2p_sift.pin is 0; expected the number of one of its associations",
    ),
    "pin beyond": (("pin: null", "pin: 99"), "members.p2p_sift.pin is 99"),
    "half a pin": (("pin: null", "pin: 1.0"), "members.p2p_sift.pin is 1.0"),
    "pinned word": (("pin: null", "pin: first"), "members.p2p_sift.pin is 'first'"),
    "object": (("pin: null", "pin: !!python/object/apply:os.getcwd []"), "has the tag"),
    "no members": (("members:\n", "members: []\nothers:\n"), r"members is \[\]; expected at least one of p2p_sift"),
}


@pytest.mark.parametrize("name", BAD_EDITS)
def test_bad_edit_is_refused_by_name_and_line(components: SkillComponents, original: Path, name: str) -> None:
    change, message = BAD_EDITS[name]
    path = edited(original, change)
    with pytest.raises(InputError, match=f"^{path} line [0-9]+: ") as raised:
        read_edit(path, components, original)
    raised.match(message)
    line = int(str(raised.value).split(" line ")[1].split(":")[0])
    different = [
        number
        for number, (new, old) in enumerate(
            zip(path.read_text().splitlines(), original.read_text().splitlines(), strict=False), start=1
        )
        if new != old
    ]
    if "missing" not in name:  # where there is no line, that of the mapping is named
        assert line == different[0]


def test_changed_descriptor_of_a_pin_is_refused(components: SkillComponents, original: Path) -> None:
    text = original.read_text()
    first = yaml.safe_load(text)["descriptors"]["p2p_sift"][0][0]
    pin = ("pin: null", "pin: 1")
    for new, message in (
        ("AAAA", r"descriptors.p2p_sift\[1\] is a descriptor of 3 numbers; expected 1"),
        ("/etc/passwd", "is no descriptor"),
        (first.replace(first[:4], "AAAA"), r"descriptors.p2p_sift\[1\]\[1\] is"),
    ):
        with pytest.raises(InputError, match=message):
            read_edit(edited(original, pin, (first, new)), components, original)


def test_without_original_only_the_skill_is_compared(components: SkillComponents, original: Path) -> None:
    path = edited(original, ("source: tiles.mp4", "source: robot.mp4"))
    assert read_edit(path, components).members == ("p2p_sift", "p2l_sift_lbd")
    with pytest.raises(InputError, match="kernel is 'l2l'"):
        read_edit(edited(original, ("kernel: p2p", "kernel: l2l")), components)
    with pytest.raises(InputError, match="the definition is 3; expected a mapping with members"):
        path.write_text("3\n")
        read_edit(path, components)
