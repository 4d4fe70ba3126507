"""The checks for plug-ins pass for all built-in classes, and name what a broken class violates."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, final

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor, nn

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import all_pairs, unordered_pairs
from geoskill.kernels.kernel import Kernel
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import EXTRACTORS, KERNELS, SCORERS
from geoskill.testing import check_extractor, check_kernel, check_scorer

POINT, LINE = NodeType.POINT, NodeType.LINE

# Small, for the sake of time; of every network each architecture.
NETWORKS: list[tuple[str, dict[str, Any]]] = [
    ("bilinear", {"hidden_dim": 8}),
    ("prototypes", {"prototypes": 5, "components": 3}),
    ("message_passing", {"hidden_dim": 8, "layers": 2, "shared_weights": True, "read_out": "product"}),
    ("message_passing", {"hidden_dim": 8, "layers": 2, "shared_weights": False, "read_out": "perceptron"}),
    (
        "message_passing",
        {
            "hidden_dim": 8,
            "layers": 2,
            "shared_weights": True,
            "read_out": "product",
            "encoder_dim": 6,
            "prototypes": 5,
            "cascade": 20,
        },
    ),
]


@pytest.mark.parametrize("name", KERNELS.built_in)
def test_built_in_kernels_pass(name: str) -> None:
    check_kernel(KERNELS.get(name))


@pytest.mark.parametrize("name", [name for name in EXTRACTORS.built_in if "weights" not in EXTRACTORS.parameters(name)])
def test_built_in_extractors_pass(name: str) -> None:
    check_extractor(EXTRACTORS.get(name))


@pytest.mark.parametrize(("name", "arguments"), NETWORKS)
def test_built_in_scorers_pass(name: str, arguments: dict[str, Any]) -> None:
    check_scorer(partial(SCORERS.get(name), **arguments))


def test_every_built_in_scorer_is_checked() -> None:
    assert {name for name, _ in NETWORKS} == set(SCORERS.built_in)


def test_checks_leave_the_random_generator_as_it_was() -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    check_kernel(KERNELS.get("p2p"))
    check_scorer(partial(SCORERS.get("bilinear"), hidden_dim=4))
    assert torch.equal(torch.get_rng_state(), before)


def made(base: type, members: Mapping[str, Any], changes: Mapping[str, Any], is_final: bool) -> Any:
    """A class of these members, but for the changes; None leaves a member out."""
    body = {key: value for key, value in {**members, **changes}.items() if value is not None}
    cls = type("Made", (base,), body)
    return final(cls) if is_final else cls


def kernel(is_final: bool = True, **changes: Any) -> Any:
    """Two points that come together, but for the changes."""
    members = {
        "name": "pair",
        "meaning": "two points come together",
        "roles": (POINT, POINT),
        "edges": ((0, 1),),
        "error_dim": 1,
        "resolution": 1.0,
        "instances": lambda self, counts: unordered_pairs(counts[POINT]),
        "control_error": lambda self, nodes: (nodes[0] - nodes[1]).norm(dim=1, keepdim=True),
    }
    return made(Kernel, members, changes, is_final)


def path(edges: tuple[tuple[int, int], ...]) -> Any:
    return kernel(roles=(POINT,) * 3, edges=edges, instances=lambda self, counts: torch.zeros(3, 0, dtype=torch.long))


def error(function: Callable[[Tensor, Tensor], Tensor]) -> Any:
    return kernel(control_error=lambda self, nodes: function(nodes[0], nodes[1]))


def instances(function: Callable[[int], Tensor]) -> Any:
    return kernel(instances=lambda self, counts: function(counts[POINT]))


BROKEN_KERNELS = {
    "is no concrete Kernel": int,
    "Made is no concrete Kernel": kernel(control_error=None),
    "is not @final": kernel(is_final=False),
    "has the name None": kernel(name=None),
    "has the name 'Pair of points'": kernel(name="Pair of points"),
    "has no meaning": kernel(meaning=None),
    "Made has no meaning": kernel(meaning=""),
    "has no roles": kernel(roles=None),
    "has no error_dim": kernel(error_dim=None),
    "resolution is not positive": kernel(resolution=0.0),
    "roles are no node types": kernel(roles=("point", "point")),
    "a node without an edge": path(((0, 1),)),
    "an edge of a node with itself": path(((0, 1), (1, 2), (2, 2))),
    "an edge is listed twice": path(((0, 1), (1, 2), (2, 1))),
    "is not connected": kernel(roles=(POINT,) * 4, edges=((0, 1), (2, 3))),
    "instances of torch.int32": instances(lambda count: unordered_pairs(count).int()),
    "instances have 3 rows": instances(lambda count: torch.zeros(3, 0, dtype=torch.long)),
    "a feature that is not there": instances(lambda count: unordered_pairs(count) + 1),
    "joins a feature with itself": instances(lambda count: torch.arange(count).repeat(2, 1)),
    "is listed twice": instances(lambda count: (pairs := all_pairs(count, count))[:, pairs[0] != pairs[1]]),
    "not error_dim wide": error(lambda first, second: first - second),
    "error of torch.float64": error(lambda first, second: (first - second).norm(dim=1, keepdim=True).double()),
    "error of nodes at random places is not finite": error(lambda first, second: first[:, :1] / 0),
    "error of nodes of one place and no length is not finite": error(
        lambda first, second: 1 / (first - second).norm(dim=1, keepdim=True)
    ),
    "zero error": error(lambda first, second: 0 * first[:, :1]),
    "depends on the order (1, 0)": error(lambda first, second: (first - 2 * second).norm(dim=1, keepdim=True)),
}


@pytest.mark.parametrize("violation", BROKEN_KERNELS)
@pytest.mark.usefixtures("annotations_unchecked")
def test_kernel_violation_is_named(violation: str) -> None:
    with pytest.raises(AssertionError, match=re.escape(violation)):
        check_kernel(BROKEN_KERNELS[violation])


def test_kernel_error_of_segments_without_length_must_be_finite() -> None:
    def cosine(self: Kernel, nodes: list[Tensor]) -> Tensor:
        (first, second) = (segment[:, 2:] - segment[:, :2] for segment in nodes)
        lengths = first.norm(dim=1) * second.norm(dim=1)
        return ((first * second).sum(dim=1) / lengths)[:, None]

    lines = {"roles": (LINE, LINE), "instances": lambda self, counts: unordered_pairs(counts[LINE])}
    with pytest.raises(AssertionError, match="not finite"):
        check_kernel(kernel(**lines, control_error=cosine))


def test_sound_kernel_passes() -> None:
    check_kernel(kernel())


def corners(image: np.ndarray, limit: int | None, dim: int = 4) -> FeatureSet:
    """Corners, all described by the same unit vector."""
    found, quality = cv2.goodFeaturesToTrackWithQuality(image, limit or 50, 0.01, 5, np.ones_like(image))
    if found is None:
        return FeatureSet.empty(POINT, dim)
    descriptors = np.full((len(found), dim), dim**-0.5, np.float32)
    return FeatureSet(POINT, descriptors, np.float32(found).reshape(-1, 2), np.float32(quality).reshape(-1))


def extractor(extract: Callable[..., FeatureSet] = corners, is_final: bool = True, **changes: Any) -> Any:
    """Corners, but for the changes."""

    def keep(self: Any, size: float = 1.0) -> None:
        self.size = size

    members = {
        "name": "corners",
        "node_type": POINT,
        "descriptor_dim": 4,
        "__init__": keep,
        "extract": lambda self, image, limit=None: extract(image, limit),
    }
    return made(FeatureExtractor, members, changes, is_final)


def keep_under_another_name(self: Any, size: float = 1.0) -> None:
    self.diameter = size


def keep_what_is_not_plain(self: Any, size: float = 1.0) -> None:
    self.size = [size]


def paint(image: np.ndarray, limit: int | None) -> FeatureSet:
    features = corners(image, limit)
    image[0, 0] = 255
    return features


def find_nothing(image: np.ndarray, limit: int | None) -> FeatureSet:
    return FeatureSet.empty(POINT, 4)


def change(**changes: Callable[[FeatureSet], Any]) -> Callable[..., FeatureSet]:
    """Corners with other arrays."""

    def extract(image: np.ndarray, limit: int | None) -> FeatureSet:
        features = corners(image, limit)
        return FeatureSet(
            **{
                "node_type": POINT,
                "descriptors": features.descriptors,
                "geometry": features.geometry,
                **{name: function(features) for name, function in changes.items()},
            },
            **{SCORES: getattr(features, SCORES)},
        )

    return extract


# The last of the arrays that a feature set needs.
SCORES = list(FeatureSet.__dataclass_fields__)[3]


def find_the_weakest(image: np.ndarray, limit: int | None) -> FeatureSet:
    features = corners(image, None)
    return corners(image, None) if limit is None else features.take(np.arange(len(features))[-limit:])


def find_one_everywhere(image: np.ndarray, limit: int | None) -> FeatureSet:
    features = corners(image, limit)
    lone = np.full((1, 4), 0.5, np.float32), np.zeros((1, 2), np.float32), np.ones(1, np.float32)
    return features if len(features) else FeatureSet(POINT, *lone)


def find_an_empty_set_of_another_width(image: np.ndarray, limit: int | None) -> FeatureSet:
    features = corners(image, limit)
    return features if len(features) else FeatureSet.empty(POINT, 5)


def find_the_weakest_first(image: np.ndarray, limit: int | None) -> FeatureSet:
    features = corners(image, limit)
    return features.take(np.arange(len(features))[::-1])


def wander() -> Callable[..., FeatureSet]:
    steps = iter(range(100))
    return change(geometry=lambda features: features.geometry + np.float32(next(steps) % 2))


BROKEN_EXTRACTORS = {
    "is no concrete FeatureExtractor": kernel(),
    "Made is no concrete FeatureExtractor": made(FeatureExtractor, {}, {}, True),
    "is not @final": extractor(is_final=False),
    "has the name None": extractor(name=None),
    "has no node_type": extractor(node_type=None),
    "has no descriptor_dim": extractor(descriptor_dim=None),
    "does not keep its argument size": extractor(__init__=keep_under_another_name),
    "Made.size is [1.0], which is not plain": extractor(__init__=keep_what_is_not_plain),
    "changes the picture": extractor(paint),
    "finds nothing": extractor(find_nothing),
    "finds points, not lines": extractor(node_type=LINE),
    "finds other features the second time": extractor(wander()),
    "not descriptor_dim long": extractor(descriptor_dim=5),
    "without unit norm": extractor(change(descriptors=lambda features: 2 * features.descriptors)),
    "outside of the picture": extractor(change(geometry=lambda features: features.geometry + np.float32(200))),
    "under a limit are not the strongest": extractor(find_the_weakest),
    "features in a plain picture": extractor(find_one_everywhere),
    "an empty set has another width": extractor(find_an_empty_set_of_another_width),
    "features are not sorted": extractor(find_the_weakest_first),
}


@pytest.mark.parametrize("violation", BROKEN_EXTRACTORS)
@pytest.mark.usefixtures("annotations_unchecked")
def test_extractor_violation_is_named(violation: str) -> None:
    with pytest.raises(AssertionError, match=re.escape(violation)):
        check_extractor(BROKEN_EXTRACTORS[violation])


def test_sound_extractor_passes_with_arguments_of_choice() -> None:
    check_extractor(extractor())
    check_extractor(extractor()(size=2.0))


def test_extractor_instance_is_checked_with_its_own_arguments() -> None:
    with pytest.raises(AssertionError, match=re.escape("Made.size is (1, 2), which is not plain")):
        check_extractor(extractor()(size=(1, 2)))


Forward = Callable[["Any", Mapping[NodeType, Tensor], Tensor], Tensor]


def product(network: Any, descriptors: Mapping[NodeType, Tensor], index: Tensor) -> Tensor:
    """The score of an instance: the product of a number for each node."""
    numbers = {kind: network.weights[str(kind)](rows).squeeze(1) for kind, rows in descriptors.items()}
    terms = [numbers[role][row] for role, row in zip(network.motif.roles, index, strict=True)]
    return torch.stack(terms).prod(dim=0)


def scorer(forward: Forward = product, is_final: bool = True, **changes: Any) -> Any:
    """A network of a linear map for each node type, but for the changes."""

    def build(self: Any, motif: Motif) -> None:
        nn.Module.__init__(self)
        self.motif = motif
        self.weights = nn.ModuleDict({str(kind): nn.Linear(dim, 1) for kind, dim in motif.descriptor_dims.items()})

    return made(InstanceScorer, {"name": "made", "__init__": build, "forward": forward}, changes, is_final)


def build_without_parameters(self: Any, motif: Motif) -> None:
    nn.Module.__init__(self)


def build_with_unused_parameters(self: Any, motif: Motif) -> None:
    nn.Module.__init__(self)
    self.motif = motif
    self.weights = nn.ModuleDict({str(kind): nn.Linear(dim, 1) for kind, dim in motif.descriptor_dims.items()})
    self.unused = nn.Linear(3, 3)


def add(function: Forward) -> Any:
    """A network that adds something to its scores."""
    return scorer(lambda self, rows, index: product(self, rows, index) + function(self, rows, index))


def score_no_instance(self: Any, descriptors: Mapping[NodeType, Tensor], index: Tensor) -> Tensor:
    return product(self, descriptors, index) if index.shape[1] else torch.zeros(1)


BROKEN_SCORERS = {
    "is no concrete InstanceScorer": lambda motif: nn.Linear(3, 3),
    "is not @final": scorer(is_final=False),
    "has the name None": scorer(name=None),
    "has no parameters": scorer(__init__=build_without_parameters),
    "scores of torch.float32": scorer(lambda self, rows, index: product(self, rows, index).float()),
    "(20, 1) scores of 20 instances": scorer(lambda self, rows, index: product(self, rows, index)[:, None]),
    "scores differ the second time": add(lambda self, rows, index: torch.rand(())),
    "depend on the order (1, 0) of like nodes": add(lambda self, rows, index: rows[self.motif.roles[0]][index[0], 0]),
    "scores depend on their order": add(lambda self, rows, index: torch.arange(index.shape[1])),
    "scores depend on other instances": add(lambda self, rows, index: product(self, rows, index).sum()),
    "scores depend on the order of features": add(lambda self, rows, index: index.sum(dim=0)),
    "no instance gives a score": scorer(score_no_instance),
    "scores have no gradient": scorer(lambda self, rows, index: product(self, rows, index).detach()),
    "a score depends on features of other instances": add(
        lambda self, rows, index: sum((kind_rows**2).sum() * kind_rows.sum() for kind_rows in rows.values())
    ),
    "no gradient reaches unused.weight, unused.bias": scorer(__init__=build_with_unused_parameters),
}


@pytest.mark.parametrize("violation", BROKEN_SCORERS)
@pytest.mark.usefixtures("annotations_unchecked")
def test_scorer_violation_is_named(violation: str) -> None:
    with pytest.raises(AssertionError, match=re.escape(violation)):
        check_scorer(BROKEN_SCORERS[violation])


def test_sound_scorer_passes() -> None:
    check_scorer(scorer())
