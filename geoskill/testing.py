"""What every kernel, descriptor and network must do: checks for the tests of a plug-in.

Each check raises :class:`AssertionError` with a message that names what is violated. No check needs a test framework::

    def test_my_kernel():
        geoskill.testing.check_kernel(Perpendicular)
"""

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product

import cv2
import numpy as np
import torch
from torch import Tensor

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, automorphisms, directed_edges, node_dim
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import NAME

DESCRIPTOR_DIMS = {NodeType.POINT: 6, NodeType.LINE: 9}
NUM_FEATURES = 8
PATH = Motif((NodeType.POINT,) * 3, ((0, 1), (1, 2), (1, 0), (2, 1)), ((0, 1, 2), (2, 1, 0)), {NodeType.POINT: 6})


def check_kernel(kernel: type[Kernel]) -> None:
    """Check a kernel class.

    - It is final, and has a name, a meaning, and everything else that :class:`Kernel` lists.
    - Its motif is connected; no edge joins a node with itself or is listed twice.
    - Every association is listed once, whatever the number of features, and joins different features.
    - The control error is finite, also of coinciding points and of segments without length, of the declared width, and
      its norm does not depend on the order of nodes that the motif does not tell apart.

    Args:
        kernel: the class; it is made without arguments.

    Raises:
        AssertionError: when it does not.
    """
    name = _require_class(kernel, Kernel)
    for attribute in ("meaning", "roles", "edges", "error_dim", "resolution"):
        _require(hasattr(kernel, attribute), f"{name} has no {attribute}")
    _require(bool(kernel.meaning), f"{name} has no meaning")
    _require(kernel.error_dim >= 1 and kernel.resolution > 0, f"{name}: error_dim or resolution is not positive")
    _check_motif(kernel)
    for points, others in product((0, 1, 2, 5), (0, 1, 3)):
        _check_instances(kernel, {kind: points if kind is NodeType.POINT else others for kind in NodeType})
    for count in (0, 1, 7):
        _check_error(kernel, "nodes at random places", _random_nodes(kernel, count, torch.float32))
    _check_error(kernel, "nodes of one place and no length", [torch.full_like(rows, 5.0) for rows in _pair(kernel)])
    width = 3 if kernel.in_space else 2
    without_length = [torch.cat([rows[:, :width]] * 4, dim=1)[:, : rows.shape[1]] for rows in _pair(kernel)]
    _check_error(kernel, "nodes without length", without_length)
    nodes = _random_nodes(kernel, 50, torch.float64)
    norm = kernel().control_error(nodes).norm(dim=1)
    _require(float(norm.min()) > 0, f"{name}: zero error of nodes at random places")
    for order in automorphisms(kernel):
        exchanged = kernel().control_error([nodes[node] for node in order]).norm(dim=1)
        _require(
            torch.allclose(exchanged, norm), f"{name}: norm of the error depends on the order {order} of like nodes"
        )


def check_extractor(extractor: FeatureExtractor | type[FeatureExtractor]) -> None:
    """Check a descriptor with its detector.

    - It is final, has a name, a node type and a width, and keeps its arguments, which are plain, as attributes.
    - Features lie in the picture, strongest first, with descriptors of unit norm and declared width.
    - ``limit`` keeps the strongest, and a picture without structure or a tiny one, without depth, has no feature.
    - The same picture gives the same features, and is left unchanged.

    Args:
        extractor: an instance with arguments of your choice, or the class for its defaults.

    Raises:
        AssertionError: when it does not.
    """
    cls = extractor if isinstance(extractor, type) else type(extractor)
    name = _require_class(cls, FeatureExtractor)
    for attribute in ("node_type", "descriptor_dim"):
        _require(hasattr(cls, attribute), f"{name} has no {attribute}")
    extractor = cls() if isinstance(extractor, type) else extractor
    for argument in list(inspect.signature(cls).parameters):
        kept = vars(extractor).get(argument, ...)
        _require(kept is not ..., f"{name} does not keep its argument {argument} under this name")
        _require(
            isinstance(kept, bool | int | float | str | None), f"{name}.{argument} is {kept!r}, which is not plain"
        )
    picture = _textured_picture(round_shapes=cls.node_type is NodeType.CONIC)
    before = picture.copy()
    found, again = _extract(extractor, picture), _extract(extractor, picture)
    _require(np.array_equal(picture, before), f"{name} changes the picture")
    _require(len(found) > 0, f"{name} finds nothing in a picture full of corners and edges")
    _require(found.node_type is cls.node_type, f"{name} finds {found.node_type}s, not {cls.node_type}s")
    _require(np.array_equal(found.geometry, again.geometry), f"{name} finds other features the second time")
    _require(found.descriptors.shape[1] == cls.descriptor_dim, f"{name}: descriptors are not descriptor_dim long")
    norms = np.linalg.norm(found.descriptors, axis=1)
    _require(bool(np.allclose(norms, 1.0, atol=1e-4)), f"{name}: descriptors without unit norm")
    ends = found.geometry.reshape(-1, 2)
    height, width = picture.shape
    inside = (ends >= -1.5) & (ends <= np.array([width + 0.5, height + 0.5]))
    _require(bool(inside.all()), f"{name} finds features outside of the picture")
    few = _extract(extractor, picture, 3).geometry[:3]
    strongest = found.geometry[:3]
    kept = few.shape == strongest.shape and np.allclose(few, strongest)
    _require(kept, f"{name}: the first features under a limit are not the strongest")
    for empty in (np.full((120, 160), 90, np.uint8), np.zeros((8, 8), np.uint8)):
        nothing = _extract(extractor, empty, depth_m=math.nan)
        _require(len(nothing) == 0, f"{name} finds {len(nothing)} features in a plain picture")
        _require(nothing.descriptors.shape[1] == cls.descriptor_dim, f"{name}: an empty set has another width")


def check_scorer(build: Callable[[Motif], InstanceScorer]) -> None:
    """Check a network that scores instances.

    - Its scores do not depend on the order of nodes that the motif does not tell apart, on that of features, or on what
      other instances there are; no instance gives no score.
    - A score depends on the features of its instance only, and the gradient reaches every parameter.
    - It is final, has a name and parameters, and scores the same instances the same way again.

    Args:
        build: makes the network for a motif: the class, or a :func:`functools.partial` of it with its arguments.

    Raises:
        AssertionError: when it does not.
    """
    kernels: tuple[Kernel, ...] = (PointToPoint(), PointToLine(), LineToLine())
    motifs = [Motif.of(kernel, {role: DESCRIPTOR_DIMS[role] for role in kernel.roles}) for kernel in kernels]
    for motif in (*motifs, PATH):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(0)
            _check_network(build(motif).double(), motif)


def _check_network(network: InstanceScorer, motif: Motif) -> None:
    name = _require_class(type(network), InstanceScorer)
    _require(any(True for _ in network.parameters()), f"{name} has no parameters")
    descriptors = {
        node_type: torch.nn.functional.normalize(torch.randn(NUM_FEATURES, dim, dtype=torch.float64))
        for node_type, dim in motif.descriptor_dims.items()
    }
    network.fit_prototypes(descriptors)
    index = torch.randint(NUM_FEATURES, (len(motif.roles), 20), generator=torch.Generator().manual_seed(1))
    _check_scores(name, network, motif, descriptors, index)
    _check_gradients(name, network, motif, descriptors, index)


def _check_motif(kernel: type[Kernel]) -> None:
    name, nodes = kernel.__name__, set(range(len(kernel.roles)))
    _require(all(isinstance(role, NodeType) for role in kernel.roles), f"{name}: roles are no node types")
    _require({node for edge in kernel.edges for node in edge} == nodes, f"{name}: a node without an edge")
    _require(all(first != second for first, second in kernel.edges), f"{name}: an edge of a node with itself")
    distinct = {frozenset(edge) for edge in kernel.edges}
    _require(len(distinct) == len(kernel.edges), f"{name}: an edge is listed twice")
    reached = {0}
    for _ in nodes:
        reached |= {target for source, target in directed_edges(kernel) if source in reached}
    _require(reached == nodes, f"{name}: the motif is not connected")


def _check_error(kernel: type[Kernel], case: str, nodes: Sequence[Tensor]) -> None:
    name, count = kernel.__name__, len(nodes[0])
    error = kernel().control_error(nodes)
    _require(error.shape == (count, kernel.error_dim), f"{name}: error of {tuple(error.shape)}, not error_dim wide")
    _require(error.dtype == torch.float32, f"{name}: error of {error.dtype} for nodes of float32")
    _require(bool(torch.isfinite(error).all()), f"{name}: error of {case} is not finite")


def _check_instances(kernel: type[Kernel], counts: Mapping[NodeType, int]) -> None:
    name = kernel.__name__
    index = kernel().instances(counts)
    _require(index.dtype == torch.long, f"{name}: instances of {index.dtype}, not int64")
    _require(
        index.shape[0] == len(kernel.roles), f"{name}: instances have {index.shape[0]} rows, not one for each role"
    )
    for role, row in zip(kernel.roles, index, strict=True):
        _require(
            bool(((row >= 0) & (row < counts[role])).all()), f"{name}: an instance names a feature that is not there"
        )
    instances = [tuple(column) for column in index.T.tolist()]
    for instance in instances:
        joined = set(zip(kernel.roles, instance, strict=True))
        _require(len(joined) == len(instance), f"{name}: the instance {instance} joins a feature with itself")
    orders = [tuple(instance[node] for node in order) for instance in instances for order in automorphisms(kernel)]
    _require(len(set(orders)) == len(orders), f"{name}: an association is listed twice")


def _check_scores(
    name: str, network: InstanceScorer, motif: Motif, descriptors: Mapping[NodeType, Tensor], index: Tensor
) -> None:
    scores = network(descriptors, index)
    _require(scores.dtype == torch.float64, f"{name}: scores of {scores.dtype} for descriptors of float64")
    _require(scores.shape == (index.shape[1],), f"{name}: {tuple(scores.shape)} scores of {index.shape[1]} instances")
    _require(_equal(network(descriptors, index), scores), f"{name}: scores differ the second time")
    for order in motif.automorphisms:
        exchanged = network(descriptors, index[list(order)])
        _require(_equal(exchanged, scores), f"{name}: scores depend on the order {order} of like nodes")
    instances = torch.randperm(index.shape[1])
    _require(
        _equal(network(descriptors, index[:, instances]), scores[instances]), f"{name}: scores depend on their order"
    )
    _require(_equal(network(descriptors, index[:, :7]), scores[:7]), f"{name}: scores depend on other instances")
    features = torch.randperm(NUM_FEATURES)
    shuffled = {node_type: rows[features] for node_type, rows in descriptors.items()}
    moved = network(shuffled, torch.argsort(features)[index])
    _require(_equal(moved, scores), f"{name}: scores depend on the order of features")
    for rows in (descriptors, {node_type: rows[:0] for node_type, rows in descriptors.items()}):
        _require(network(rows, index[:, :0]).shape == (0,), f"{name}: no instance gives a score")


def _check_gradients(
    name: str, network: InstanceScorer, motif: Motif, descriptors: Mapping[NodeType, Tensor], index: Tensor
) -> None:
    inputs = {node_type: rows.clone().requires_grad_() for node_type, rows in descriptors.items()}
    for number in (0, 7):
        score = network(inputs, index)[number]
        _require(score.requires_grad, f"{name}: scores have no gradient")
        gradients = torch.autograd.grad(score, list(inputs.values()), allow_unused=True, materialize_grads=True)
        for node_type, gradient in zip(inputs, gradients, strict=True):
            own = {int(row[number]) for role, row in zip(motif.roles, index, strict=True) if role is node_type}
            touched = {int(feature) for feature in gradient.abs().sum(dim=1).nonzero()}
            _require(touched <= own, f"{name}: a score depends on features of other instances")
    network.zero_grad()
    scores = network(descriptors, index)
    (scores @ torch.randn_like(scores)).backward()
    unreached = [key for key, weights in network.named_parameters() if weights.grad is None or not weights.grad.any()]
    _require(not unreached, f"{name}: no gradient reaches {', '.join(unreached)}")


def _extract(
    extractor: FeatureExtractor, picture: np.ndarray, limit: int | None = None, depth_m: float = 0.7
) -> FeatureSet:
    height, width = picture.shape
    camera = DepthCamera(width, width, width / 2, height / 2)
    depth = DepthPicture(np.full(picture.shape, depth_m, np.float32), camera)
    try:
        return extractor.extract_in_depth(picture, depth, limit)
    except ValueError as error:  # of a FeatureSet, which checks what it is given
        raise AssertionError(f"{type(extractor).__name__}: {error}") from error


def _pair(kernel: type[Kernel]) -> list[Tensor]:
    return _random_nodes(kernel, 2, torch.float32)


def _random_nodes(kernel: type[Kernel], count: int, dtype: torch.dtype) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    return [100 * torch.rand(count, node_dim(kernel, role), dtype=dtype, generator=generator) for role in kernel.roles]


def _textured_picture(*, round_shapes: bool) -> np.ndarray:
    """Return a gray picture of 240x320 with bright, dark and turned rectangles, or with discs."""
    random = np.random.default_rng(0)
    picture = np.full((240, 320), 120, np.float32)
    for _ in range(40):
        middle, size = random.uniform((20, 20), (300, 220)), random.uniform(12, 50, 2)
        if round_shapes:
            center = middle.round().astype(int).tolist()
            cv2.circle(picture, center, round(size[0]), float(random.uniform(0, 255)), cv2.FILLED, cv2.LINE_AA)
            continue
        corners = cv2.boxPoints((middle.tolist(), size.tolist(), float(random.uniform(0, 180))))
        cv2.fillPoly(picture, [corners.round().astype(np.int32)], float(random.uniform(0, 255)))
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.float32).clip(0, 255).astype(np.uint8)


def _equal(first: Tensor, second: Tensor) -> bool:
    return torch.allclose(first, second, rtol=0, atol=1e-9)


def _require_class(cls: type, base: type) -> str:
    """Require what every plug-in must be, and return the name of its class for messages."""
    shown = getattr(cls, "__name__", repr(cls))
    concrete = isinstance(cls, type) and issubclass(cls, base) and not inspect.isabstract(cls)
    _require(concrete, f"{shown} is no concrete {base.__name__}")
    _require("__final__" in vars(cls), f"{shown} is not @final")
    name = getattr(cls, "name", None)
    _require(
        isinstance(name, str) and NAME.fullmatch(name) is not None,
        f"{shown} has the name {name!r}; expected small letters, digits and _",
    )
    return shown


def _require(satisfied: bool, message: str) -> None:
    if not satisfied:
        raise AssertionError(message)
