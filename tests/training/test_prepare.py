"""Demonstrations whose pictures and flows do not fit into memory."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from geoskill.config import DemonstrationConfig, TrainConfig
from geoskill.data.demonstrations import Demonstrations
from geoskill.io import kept_frames
from geoskill.skill.build import build_skill
from geoskill.skill.spec import SkillSpec
from geoskill.tracking import neighbor_flows
from geoskill.training.prepare import prepare


def prepared(folder: Path, spec: SkillSpec) -> Demonstrations:
    config = TrainConfig(demonstration=DemonstrationConfig(num_negatives=5))
    return prepare(config, [folder], build_skill(spec), None, None)[0]


@pytest.mark.slow
def test_memory_does_not_change_what_is_learned_from(
    demonstration_folder: Path, spec: SkillSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = prepared(demonstration_folder, spec)
    for module in (kept_frames, neighbor_flows):
        monkeypatch.setattr(module, "KEPT_MB", 0.0)
    again = prepared(demonstration_folder, spec)
    assert len(kept) == len(again) > 40
    for index in range(0, len(kept), 3):
        for name, graphs in kept[index].items():
            for which, graph in graphs.items():
                other = again[index][name][which]
                for key, value in graph.to_dict().items():
                    if isinstance(value, torch.Tensor):
                        torch.testing.assert_close(other[key], value, rtol=0, atol=0, equal_nan=True)


PROGRAM = """
import resource, sys
import numpy as np
import lightning
from geoskill.config import TrainConfig
from geoskill.io import kept_frames
from geoskill.io.frames import Frame, FrameSource
from geoskill.skill.build import build_skill
from geoskill.skill.plan import plan_skill
from geoskill.tracking import neighbor_flows
from geoskill.training.prepare import prepare

kept_frames.KEPT_MB = neighbor_flows.KEPT_MB = 10.0
pattern = np.kron(np.random.default_rng(0).integers(0, 256, (24, 32, 3)), np.ones((10, 10, 1))).astype(np.uint8)

class Long(FrameSource):
    name, frame_rate = "long", 30.0

    def __iter__(self):
        for number in range(int(sys.argv[1])):
            yield Frame(number, number / 30, np.ascontiguousarray(np.roll(pattern, number, axis=1)))

config = TrainConfig()
config.features.min_side = 0
config.demonstration.use_places = False  # which takes memory up to its own limit
config.demonstration.trajectory.max_gap_hops = 4
spec = plan_skill("p2p", "orb", config.model, config.features, 10)
prepare(config, [Long()], build_skill(spec), None, None)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
"""


@pytest.mark.slow
def test_memory_hardly_grows_with_the_length_of_a_demonstration() -> None:
    """A frame of five minutes at 30 Hz may take 0.15 MB, for 2 GiB to suffice; picture and flow would take 1.5 MB."""
    root = Path(__file__).resolve().parents[2]
    peaks_mb = [
        float(
            subprocess.run(
                [sys.executable, "-c", PROGRAM, str(count)], cwd=root, capture_output=True, text=True, check=True
            ).stdout
        )
        for count in (40, 100)
    ]
    growth_mb = float(np.subtract(*peaks_mb[::-1])) / 60
    assert growth_mb < 0.15
