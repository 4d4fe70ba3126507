"""Flows that are kept, and flows that are computed when they are asked for, are the same."""

from collections.abc import Iterable, Sequence

import numpy as np
import pytest

from geoskill.tracking.flow import Flow, dense_flow
from geoskill.tracking.neighbor_flows import neighbor_flows


def silent(items: Sequence[int], _: str) -> Iterable[int]:
    return items


@pytest.fixture(scope="module")
def frames() -> list[np.ndarray]:
    """Eight frames with a shorter side above the working size, in which a pattern moves to the right."""
    pattern = np.kron(np.random.default_rng(0).integers(0, 256, (50, 80, 3)), np.ones((10, 10, 1))).astype(np.uint8)
    return [np.ascontiguousarray(np.roll(pattern, 4 * number, axis=1)) for number in range(8)]


def check_equal(first: Flow, second: Flow) -> None:
    assert first.scale == second.scale
    np.testing.assert_array_equal(first.forward, second.forward)
    assert first.backward is not None
    np.testing.assert_array_equal(first.backward, second.backward)


@pytest.mark.parametrize("hop", [1, 3])
@pytest.mark.parametrize("memory_mb", [1000.0, 0.0])
@pytest.mark.parametrize("side", [500, 240])  # reduced, and not
def test_flows_are_those_between_the_frames(frames: list[np.ndarray], hop: int, memory_mb: float, side: int) -> None:
    frames = [np.ascontiguousarray(frame[:side, :side]) for frame in frames]
    flows = neighbor_flows(frames, hop, silent, recent=2, memory_mb=memory_mb)
    assert len(flows) == 8 - hop
    for start in (*range(8 - hop), 0, 2):
        check_equal(flows[start], dense_flow(frames[start], frames[start + hop]))
    check_equal(flows[-1], dense_flow(frames[-1 - hop], frames[-1]))
    check_equal(flows[1:3][0], flows[1])
    with pytest.raises(IndexError):
        flows[8 - hop]


def test_recent_flows_are_kept(frames: list[np.ndarray]) -> None:
    flows = neighbor_flows(frames, 1, silent, recent=2, memory_mb=0.0)
    kept = [flows[number] for number in range(4)]
    assert all(flows[number] is kept[number] for number in range(4))  # as many as are asked for again, and the hop
    assert flows[4] is not None
    assert flows[0] is not kept[0]


@pytest.mark.parametrize(("memory_mb", "steps"), [(1000.0, 6), (0.0, 8)])
def test_progress_is_shown(frames: list[np.ndarray], memory_mb: float, steps: int) -> None:
    shown: list[tuple[int, str]] = []

    def progress(items: Sequence[int], description: str) -> Iterable[int]:
        shown.append((len(items), description))
        return items

    neighbor_flows(frames, 2, progress, memory_mb=memory_mb)
    assert shown == [(steps, "following motion")]
