"""How much is computed, in operations and extractions: a doubling of the work fails here, whatever the machine."""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.nn.functional import normalize
from torch.utils.flop_counter import FlopCounterMode

from geoskill.config import FeaturesConfig, MessagePassingConfig, TrainConfig
from geoskill.data.datamodule import TransitionData
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, with_instances
from geoskill.io.disk_cache import DiskCache
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import MessagePassing
from geoskill.skill.build import build_skill
from geoskill.skill.plan import plan_skill
from geoskill.training.prepare import prepare
from geoskill.training.statistics import fit_statistics
from geoskill.tuning import NegativesConfig

Product = tuple[int, int, int]
"""Rows and columns of a matrix, and the columns of the matrix that it is multiplied with."""

pytestmark = pytest.mark.usefixtures("annotations_unchecked")  # checking types would take most of the time

# A `Training` is what the fixtures of training_runs.py make; see there.
Training = Any


def passes(scorer: MessagePassing, features: int, instances: int) -> list[tuple[int, list[Product]]]:
    """Matrix products of the scores of unordered pairs, from the sizes of the layers, with their passes in training.

    In the backward pass a product takes as many operations for its weights as forward, and as many for its input. Two
    kinds are spared some: weights of what has no gradient, such as descriptors, and what has none at all.
    """
    hidden, steps, nodes = scorer.hidden_dim, scorer.steps, 2 * instances
    first, _, second = scorer.encoder.layers["point"]
    assert scorer.prototype_score is not None
    prototypes, components = scorer.prototype_score.weights[0].shape
    descriptor_dim, width = first.in_features, first.out_features
    trained = [
        (features, width, second.out_features),  # the encoder's second layer
        (features, hidden, 5 * hidden),  # of the first step's states: as source, as destination, and for three gates
        *[(nodes, hidden, 5 * hidden)] * (steps - 1),  # the same in later steps, where every instance has its own
        *[(nodes, hidden, 3 * hidden)] * steps,  # from messages to the gates
        *[(nodes, hidden, hidden), (nodes, hidden, 2 * hidden)] * 2,  # the read-out's two perceptrons
        # The last layer of the messages and its bias, joined with the gates once.
        *[(3 * hidden, hidden, hidden), (1, hidden, 3 * hidden)],
    ]
    untrained_input = [
        (features, descriptor_dim, width),  # the encoder's first layer
        *[(features, prototypes, components)] * 2,  # weights of similarities, in each role
    ]
    constant = [(features, descriptor_dim, prototypes)]  # similarities to the demonstration
    return [(3, trained), (2, untrained_input), (1, constant)]


def operations(products: Sequence[Product]) -> int:
    return sum(2 * rows * inner * columns for rows, inner, columns in products)


@pytest.mark.parametrize("dropout", [0.0, 0.5])
def test_training_step_computes_on_visible_features_alone(
    training_of: Callable[..., Training], monkeypatch: pytest.MonkeyPatch, dropout: float
) -> None:
    training = training_of("p2p_sift")
    module = training.module(feature_dropout=dropout)
    monkeypatch.setattr(module, "log", lambda *_, **__: None)  # there is no trainer
    batch = next(iter(TransitionData(training.demonstration, batch_size=8, seed=5).train_dataloader()))
    sizes = []

    def recorded(*arguments: Any) -> MotifGraph:
        graph = with_instances(*arguments)
        sizes.append((int(graph.point_count.sum()), graph.instance_index.shape[1]))
        return graph

    monkeypatch.setattr("geoskill.training.module.with_instances", recorded)
    with FlopCounterMode(display=False) as counter:
        module.training_step(batch, 0).backward()
    shown = [batch["p2p_sift"][which].node_count(NodeType.POINT) for which in ("first", "second")]
    visible = [features for features, _ in sizes]
    least, most = (1.0, 1.0) if dropout == 0 else (0.25, 0.75)
    assert all(least * n <= v <= most * n for v, n in zip(visible, shown, strict=True))
    scorer = module.members["p2p_sift"].scorer
    expected = sum(times * operations(products) for own in sizes for times, products in passes(scorer, *own))
    assert counter.get_total_flops() == expected


def test_forward_pass_computes_no_more_than_its_layers_say() -> None:
    """One frame of 20 features under the default network: similarities of all pairs come from one product of tables."""
    spec = plan_skill("p2p", "sift", MessagePassingConfig(), FeaturesConfig(), top_k=10)
    scorer = build_skill(spec).members["p2p_sift"].scorer
    assert isinstance(scorer, MessagePassing)
    descriptors = {NodeType.POINT: normalize(torch.randn(20, 138))}
    index = PointToPoint().instances({NodeType.POINT: 20})
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        scorer.eval()(descriptors, index)
    forward = [product for _, products in passes(scorer, 20, 190) for product in products]
    table = (20, 16, 20)
    assert counter.get_total_flops() == operations([*forward, table])


def test_demonstration_extracts_every_picture_once(
    pictures: np.ndarray, configured: Callable[..., TrainConfig], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Five frames, and of two of them three transformed pictures and two of dead leaves for the negatives."""
    extracted: Counter[bytes] = Counter()
    original = FeaturePipeline._extract

    def counted(pipeline: FeaturePipeline, frame: np.ndarray, depth: None) -> FeatureSet:
        extracted[frame.tobytes()] += 1
        return original(pipeline, frame, depth)

    monkeypatch.setattr(FeaturePipeline, "_extract", counted)
    negatives = NegativesConfig(source_frames=2, leaves_per_frame=2)
    config = configured(demonstration={"num_negatives": 5, "negatives": negatives})
    spec = plan_skill(config.kernel, "sift", config.model, config.features, config.inference.top_k)
    components = build_skill(spec, FeatureCache(DiskCache(tmp_path)), config.seed)
    demonstration, _ = prepare(config, [pictures[:5]], components, progress=None, scene=None)
    assert sorted(extracted.values()) == [1] * (5 + 2 * (3 + 2))
    fit_statistics(components.members, demonstration, config.objective, config.demonstration.descriptor_noise)
    for index in range(len(demonstration)):
        demonstration[index]
    assert extracted.total() == 15, "what follows takes features from memory"
    again = build_skill(spec, FeatureCache(DiskCache(tmp_path)), config.seed)
    prepare(config, [pictures[:5]], again, progress=None, scene=None)
    assert extracted.total() == 15, "a second training takes them from the cache"
