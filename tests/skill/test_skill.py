"""Loading skills from good and bad files, and inference on frames that may show anything."""

import copy
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from geoskill import Skill as PublicSkill
from geoskill.config import FeaturesConfig
from geoskill.errors import InputError
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance, read_skill, skill_entry
from geoskill.skill.plan import plan_skill
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec
from geoskill.skill.temporal_filter import TemporalFilter


@pytest.fixture
def skill(skill_file: Path) -> Skill:
    return Skill.load(skill_file)


@pytest.fixture
def frame(demonstration_frames: tuple[np.ndarray, ...]) -> np.ndarray:
    return demonstration_frames[6]


def test_skill_is_public() -> None:
    assert PublicSkill is Skill


def test_load_takes_weights_from_the_file(skill: Skill, checkpoint: dict[str, Any]) -> None:
    assert list(skill.members) == ["p2p_sift", "p2l_sift_lbd"]
    assert list(skill.pipelines) == ["sift", "lbd"]
    for name, member in skill.members.items():
        assert not member.training
        for key, weight in member.state_dict().items():
            assert torch.equal(weight, checkpoint["state_dict"][f"members.{name}.{key}"])
        assert member.spans.tolist() == [2, 4]
        assert member.beta.tolist() == [0.5, 0.25]


def no_file(path: Path) -> None:
    path.unlink()


def empty_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def an_empty_file(path: Path) -> None:
    path.write_bytes(b"")


def random_bytes(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(5000))


def half_of_it(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def all_but_the_end(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1])


def a_picture(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))


def text(path: Path) -> None:
    path.write_text("kernel: p2p\n")


def a_pickle_that_acts(path: Path) -> None:
    torch.save({"skill": Acting(path.with_name("acted")), "state_dict": {}}, path)


class Acting:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (no_file, "no such file; expected the skill.ckpt of a training run"),
        (an_empty_file, r"cannot be read as a checkpoint \(it is broken\); expected the skill.ckpt of a training run"),
        (random_bytes, "cannot be read as a checkpoint"),
        (half_of_it, "cannot be read as a checkpoint"),
        (all_but_the_end, "cannot be read as a checkpoint"),
        (a_picture, "cannot be read as a checkpoint"),
        (text, "cannot be read as a checkpoint"),
        (a_pickle_that_acts, "cannot be read as a checkpoint"),
    ],
)
def test_load_refuses_damaged_files(skill_file: Path, damage: Callable[[Path], None], message: str) -> None:
    damage(skill_file)
    with pytest.raises(InputError, match=f"^{skill_file}: {message}"):
        Skill.load(skill_file)
    with pytest.raises(InputError, match=f"^{skill_file}: {message}"):
        read_skill(str(skill_file))
    assert not skill_file.with_name("acted").exists()


@pytest.mark.parametrize("content", [{"state_dict": {}}, {"skill": {}}, {}, [1, 2], torch.zeros(3), "skill"])
def test_load_refuses_checkpoints_of_other_programs(tmp_path: Path, content: Any) -> None:
    path = tmp_path / "other.ckpt"
    torch.save(content, path)
    with pytest.raises(InputError, match=f"^{path}: is no skill of this program; expected the skill.ckpt"):
        Skill.load(path)


def wider(checkpoint: dict[str, Any]) -> None:
    checkpoint["skill"]["specification"]["model"]["arguments"]["hidden_dim"] = 9


def without_a_weight(checkpoint: dict[str, Any]) -> None:
    del checkpoint["state_dict"]["members.p2p_sift.beta"]


def of_another_member(checkpoint: dict[str, Any]) -> None:
    checkpoint["state_dict"] = {
        key.replace("p2p_sift", "p2p_orb"): weight for key, weight in checkpoint["state_dict"].items()
    }


def another_kernel(checkpoint: dict[str, Any]) -> None:
    checkpoint["skill"]["specification"]["members"]["p2l_sift_lbd"]["kernel"]["name"] = "l2l"


def another_node_type(checkpoint: dict[str, Any]) -> None:
    checkpoint["skill"]["specification"]["members"]["p2l_sift_lbd"]["extractors"] = {"point": "sift"}


def swapped_extractors(checkpoint: dict[str, Any]) -> None:
    checkpoint["skill"]["specification"]["members"]["p2l_sift_lbd"]["extractors"] = {"point": "lbd", "line": "sift"}


def another_shape(checkpoint: dict[str, Any]) -> None:
    checkpoint["state_dict"]["members.p2p_sift.reference_margin"] = torch.zeros(2)


@pytest.mark.parametrize(
    "change",
    [
        wider,
        without_a_weight,
        of_another_member,
        another_kernel,
        another_node_type,
        swapped_extractors,
        another_shape,
    ],
)
def test_load_refuses_weights_that_do_not_fit(
    tmp_path: Path, checkpoint: dict[str, Any], change: Callable[[dict[str, Any]], None]
) -> None:
    checkpoint = copy.deepcopy(checkpoint)
    change(checkpoint)
    path = tmp_path / "unfit.ckpt"
    torch.save(checkpoint, path)
    with pytest.raises(InputError, match=rf"^{path}: its weights do not fit its specification \(.+\)$") as caught:
        Skill.load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_load_refuses_old_formats_with_what_to_do(tmp_path: Path, checkpoint: dict[str, Any], number: int) -> None:
    """Until format 2, the entry ``skill`` was the specification itself."""
    path = tmp_path / "earlier.ckpt"
    description = {"format": number, "members": {}, "extractors": {}, "model": {}, "features": {}, "alternatives": 4}
    torch.save({**checkpoint, "skill": description}, path)
    with pytest.raises(
        InputError,
        match=rf"^{path}: the skill's format is {number}; expected 5 \(learn it again with this version\)$",
    ):
        Skill.load(path)


def test_load_takes_a_run_folder(skill_file: Path, skill: Skill, frame: np.ndarray) -> None:
    for reference in (skill_file.parent, str(skill_file.parent), str(skill_file)):
        assert Skill.load(reference).infer(frame).associations == skill.infer(frame).associations


def test_load_refuses_a_folder_without_skill(skill_file: Path) -> None:
    empty_folder(skill_file)
    for folder in (skill_file, skill_file.parent / "skill.ckpt"):
        with pytest.raises(InputError, match=rf"^{folder}/skill\.ckpt: no such file; expected the skill\.ckpt of a t"):
            Skill.load(folder)


def test_save_and_load(skill: Skill, tmp_path: Path, frame: np.ndarray) -> None:
    skill.save(tmp_path / "saved.ckpt")
    loaded = Skill.load(tmp_path / "saved.ckpt")
    assert (loaded.spec, loaded.provenance) == (skill.spec, skill.provenance)
    assert repr(loaded) == repr(skill)
    for name, member in skill.members.items():
        state = loaded.members[name].state_dict()
        assert list(state) == list(member.state_dict())
        assert all(torch.equal(value, state[key]) for key, value in member.state_dict().items())
    assert loaded.infer(frame).associations == skill.infer(frame).associations
    assert list(tmp_path.glob("saved*")) == [tmp_path / "saved.ckpt"]


def test_repr_says_where_the_skill_comes_from(skill: Skill) -> None:
    assert repr(skill) == (
        "Skill(p2p_sift, p2l_sift_lbd; learned from tiles.mp4 at 160x120, 2026-02-03T04:05:06+00:00,"
        " geoskill 1.2.3, seed 7; objective 0.25, rsw 0.0625)"
    )


def test_unfinished_skill_loads_with_a_warning(
    spec: SkillSpec, provenance: Provenance, checkpoint: dict[str, Any], tmp_path: Path
) -> None:
    path = tmp_path / "skill.ckpt"
    unfinished = replace(provenance, finished=False, epochs=(3, 16), metrics={})
    torch.save({**checkpoint, "skill": skill_entry(spec, unfinished, {})}, path)
    message = f"{path} is unfinished (3 of 16 epochs): its confidence is not calibrated; go on with ckpt_path={path}"
    with pytest.warns(UserWarning, match=f"^{re.escape(message)}$"):
        skill = Skill.load(tmp_path)
    assert repr(skill).endswith("seed 7, unfinished: 3 of 16 epochs)")


@pytest.mark.parametrize("device", ["cuda:77", "nowhere"])
def test_load_refuses_missing_devices(skill_file: Path, device: str) -> None:
    with pytest.raises(InputError, match=rf"^device={device}: [^\n]+ \(expected one such as cpu\)$"):
        Skill.load(skill_file, device=device)


def test_load_with_another_precision(skill_file: Path, frame: np.ndarray) -> None:
    exact, low = Skill.load(skill_file).observe(frame), Skill.load(skill_file, precision="bfloat16").observe(frame)
    for name, member in exact.members.items():
        assert not torch.equal(member.scores, low.members[name].scores)
        torch.testing.assert_close(low.members[name].scores, member.scores, rtol=0, atol=0.05)
    with pytest.raises(InputError, match=r"^precision=half: expected float32 or bfloat16$"):
        Skill.load(skill_file, precision="half")


def test_network_without_messages_has_one_precision(spec: SkillSpec, provenance: Provenance, tmp_path: Path) -> None:
    bilinear = plan_skill("p2p", "sift", {"name": "bilinear", "hidden_dim": 8}, FeaturesConfig(), top_k=4).model
    spec = replace(spec, model=bilinear)
    weights = {
        f"members.{name}.{key}": value
        for name, member in build_skill(spec).members.items()
        for key, value in member.state_dict().items()
    }
    path = tmp_path / "bilinear.ckpt"
    torch.save({"skill": skill_entry(spec, provenance, {}), "state_dict": weights}, path)
    Skill.load(path, precision="float32")
    with pytest.raises(
        InputError, match=r"^precision=bfloat16: Bilinear passes no messages; expected float32 or null$"
    ):
        Skill.load(path, precision="bfloat16")


@pytest.mark.slow
def test_load_and_infer_do_not_import_lightning(skill_file: Path, frame: np.ndarray, tmp_path: Path) -> None:
    np.save(tmp_path / "frame.npy", frame)
    program = (
        "import sys, numpy, geoskill\n"
        f"skill = geoskill.Skill.load({str(skill_file)!r})\n"
        f"frame = numpy.load({str(tmp_path / 'frame.npy')!r})\n"
        "for selecting in (skill, geoskill.TemporalFilter(skill)):\n"
        "    print(len(selecting.infer(frame).associations))\n"
        "print({name for name in sys.modules if 'lightning' in name.partition('.')[0]})"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert ended.stdout.splitlines() == ["8", "8", "set()"]


def test_infer_lists_the_best_of_each_member_by_weight(skill: Skill, frame: np.ndarray) -> None:
    result = skill.infer(frame)
    assert [(a.kernel, a.descriptor, a.rank) for a in result.associations] == [
        *(("p2p", "sift", rank) for rank in (1, 2, 3, 4)),
        *(("p2l", "sift+lbd", rank) for rank in (1, 2, 3, 4)),
    ]
    for member in (result.associations[:4], result.associations[4:]):
        weights = [association.weight for association in member]
        assert weights == sorted(weights, reverse=True)
        assert all(0 < weight < 1 for weight in weights)
        assert sum(weights) < 1
        assert len({association.nodes for association in member}) == 4
    assert result.reasons == {}


def test_weight_is_the_share_of_all_instances(skill: Skill, frame: np.ndarray) -> None:
    skill.spec = replace(skill.spec, top_k=1000)
    result = skill.infer(frame)
    points, lines = (len(result.features[name]) for name in ("sift", "lbd"))
    p2p = [a.weight for a in result.associations if a.kernel == "p2p"]
    p2l = [a.weight for a in result.associations if a.kernel == "p2l"]
    assert (len(p2p), len(p2l)) == (points * (points - 1) // 2, points * lines)
    assert sum(p2p) == pytest.approx(1, abs=1e-5)
    assert sum(p2l) == pytest.approx(1, abs=1e-5)


def test_confidence_compares_the_margin_with_that_of_the_demonstration(skill: Skill, frame: np.ndarray) -> None:
    before = skill.infer(frame)
    assert [a.confidence for a in before.associations] == [a.weight for a in before.associations], "of no training"
    observed = skill.observe(frame).members["p2p_sift"]
    lead = observed.scores.max() - observed.scores.mean()
    for usual, expected in ((lead, 0.9885), (2 * lead, 0.3788), (10 * lead, 0.0115)):
        skill.members["p2p_sift"].set_reference_margin(usual)
        result = skill.infer(frame)
        assert result.associations[0].confidence == pytest.approx(expected, abs=1e-4)
        confidences = [a.confidence for a in result.associations if a.kernel == "p2p"]
        assert confidences == sorted(confidences, reverse=True)
        assert [a.weight for a in result.associations] == [a.weight for a in before.associations]


def test_nodes_are_the_features_they_name(skill: Skill, frame: np.ndarray) -> None:
    result = skill.infer(frame)
    for association in result.associations:
        for node, name in zip(
            association.nodes, ("sift", {"p2p": "sift", "p2l": "lbd"}[association.kernel]), strict=True
        ):
            assert node.feature is not None
            assert node.node_type is result.features[name].node_type
            detected = result.features[name].geometry[node.feature].reshape(-1, 2).tolist()
            ends = np.reshape(node.coordinates, (-1, 2)).tolist()
            assert ends in (detected, detected[::-1])
            assert len(ends) == 1 or ends[1][0] > ends[0][0], "the axis of an untrained skill is to the right"


def test_errors_are_the_control_errors_of_the_nodes(skill: Skill, frame: np.ndarray) -> None:
    result = skill.infer(frame)
    kernels = {member.kernel.name: member.kernel for member in skill.members.values()}
    for association in result.associations:
        nodes = [torch.tensor([node.coordinates]) for node in association.nodes]
        expected = kernels[association.kernel].control_error(nodes)[0]
        torch.testing.assert_close(torch.tensor(association.error), expected)
    first = result.associations[0]
    (xa, ya), (xb, yb) = (node.coordinates for node in first.nodes)
    assert first.error == pytest.approx((xa - xb, ya - yb), abs=1e-4)


def test_error_of_an_ensemble_is_that_of_its_top_associations(skill: Skill, frame: np.ndarray) -> None:
    result = skill.infer(frame)
    assert result.error.shape == (2 + 1,)
    assert result.error.tolist() == [*result.associations[0].error, *result.associations[4].error]


def test_ensemble_infers_what_its_members_infer_alone(
    skill: Skill, tmp_path: Path, checkpoint: dict[str, Any], frame: np.ndarray
) -> None:
    together = skill.infer(frame)
    for name, part in (("p2p_sift", slice(0, 4)), ("p2l_sift_lbd", slice(4, 8))):
        alone = copy.deepcopy(checkpoint)
        members = alone["skill"]["specification"]["members"]
        alone["skill"]["specification"]["members"] = {name: members[name]}
        torch.save(alone, tmp_path / f"{name}.ckpt")
        assert Skill.load(tmp_path / f"{name}.ckpt").infer(frame).associations == together.associations[part]


def test_infer_is_repeatable(skill_file: Path, frame: np.ndarray, demonstration_frames: Any) -> None:
    skill = Skill.load(skill_file)
    first = skill.infer(frame)
    skill.infer(demonstration_frames[0])
    again, other = skill.infer(frame.copy()), Skill.load(skill_file).infer(frame)
    assert first.associations == again.associations == other.associations
    assert np.array_equal(first.error, again.error)


def test_infer_takes_extracted_features(skill: Skill, frame: np.ndarray, demonstration_frames: Any) -> None:
    other = demonstration_frames[-1]
    for selecting in (skill.infer, TemporalFilter(skill).infer):
        assert selecting(frame, skill.extract(frame)).associations == skill.infer(frame).associations
    assert skill.infer(frame, skill.extract(other)).associations == skill.infer(other).associations
    assert skill.infer(other).associations != skill.infer(frame).associations


def test_infer_on_a_frame_without_features(skill: Skill) -> None:
    result = skill.infer(np.full((90, 120, 3), 77, np.uint8))
    assert result.associations == ()
    assert np.isnan(result.error).all()
    assert result.error_available.tolist() == [False] * 3
    assert np.isnan(result.error_std).all()
    assert result.error_names == ("p2p_sift.x", "p2p_sift.y", "p2l_sift_lbd.distance")
    assert result.error_units == ("px", "px", "px")
    assert result.states == {"p2p_sift": "lost", "p2l_sift_lbd": "lost"}
    assert result.reasons == {
        "p2p_sift": "no instance: 0 points found",
        "p2l_sift_lbd": "no instance: 0 points, 0 lines found",
    }
    assert {name: len(found) for name, found in result.features.items()} == {"sift": 0, "lbd": 0}


def test_member_without_instance_leaves_the_others_alone(skill: Skill, frame: np.ndarray) -> None:
    skill.pipelines["lbd"].max_features = 0
    result = skill.infer(frame)
    assert [association.kernel for association in result.associations] == ["p2p"] * 4
    assert result.reasons == {"p2l_sift_lbd": "no instance: 10 points, 0 lines found"}
    assert result.error[result.rows_of("p2p_sift")].tolist() == list(result.associations[0].error)
    assert np.isnan(result.error[result.rows_of("p2l_sift_lbd")]).all()
    assert result.error_available.tolist() == [True, True, False]
    np.testing.assert_allclose(result.error_std[:2], 0.5 * 2**0.5, rtol=1e-6)
    assert result.states == {"p2p_sift": "approaching", "p2l_sift_lbd": "lost"}
    with pytest.raises(KeyError, match="p2p_orb"):
        result.rows_of("p2p_orb")


def test_fewer_instances_than_top_k(skill: Skill, frame: np.ndarray) -> None:
    skill.pipelines["sift"].max_features = 2
    result = skill.infer(frame)
    pair = [association for association in result.associations if association.kernel == "p2p"]
    assert len(pair) == 1
    assert pair[0].confidence == 1.0


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        (np.zeros((4, 5), np.uint8), r"uint8 \[4, 5\]"),
        (np.zeros((4, 5, 4), np.uint8), r"uint8 \[4, 5, 4\]"),
        (np.zeros((4, 5, 1), np.uint8), r"uint8 \[4, 5, 1\]"),
        (np.zeros((4, 5, 3), np.float32), r"float32 \[4, 5, 3\]"),
        (np.zeros((2, 4, 5, 3), np.uint8), r"uint8 \[2, 4, 5, 3\]"),
        (np.zeros((0, 5, 3), np.uint8), r"uint8 \[0, 5, 3\]"),
    ],
)
@pytest.mark.usefixtures("annotations_unchecked")
def test_infer_refuses_other_arrays(skill: Skill, frame: np.ndarray, said: str) -> None:
    with pytest.raises(InputError, match=rf"^the frame is {said}; expected uint8 \[height, width, 3\], RGB$"):
        skill.infer(frame)


def test_infer_on_the_smallest_frames(skill: Skill) -> None:
    for height, width in ((1, 1), (1, 50), (7, 3)):
        assert skill.infer(np.zeros((height, width, 3), np.uint8)).associations == ()


def test_moving_node_comes_first_and_decides_the_sign(skill: Skill, frame: np.ndarray) -> None:
    member = skill.members["p2p_sift"]
    node_order = torch.randn(128, generator=torch.Generator().manual_seed(0))
    member.set_node_order(node_order)
    listed = [item for item in skill.infer(frame).associations if item.kernel == "p2p"]
    descriptors = torch.from_numpy(skill.infer(frame).features["sift"].descriptors)
    member.set_node_order(-node_order)
    opposite = [item for item in skill.infer(frame).associations if item.kernel == "p2p"]
    for one, other in zip(listed, opposite, strict=True):
        assert one.nodes == other.nodes[::-1]
        assert one.error == tuple(-component for component in other.error)
        assert one.confidence == other.confidence
        first, second = (descriptors[node.feature] @ node_order for node in one.nodes)
        assert first > second
