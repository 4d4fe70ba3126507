"""LeRobot data sets and bags of ROS 2 through the commands."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.io.lerobot_data import FRONT, write_v3
from tests.io.test_bag import raw, write_bag

Command = Callable[..., Any]


@pytest.mark.slow
def test_learn_from_episodes_and_infer_on_a_bag(
    command: Command, tiny: Sequence[str], demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    frames = list(demonstration_frames)
    data_set = write_v3(tmp_path / "stacking", [frames[:3], frames, frames[::-1]])
    own = [override for override in tiny if not override.startswith("task.path=")]
    chosen = [f"task.path={data_set}", "task.episode=[1,2]", f"task.camera={FRONT}", "task.end=15f"]
    trained = command("train", *own, *chosen, f"hydra.run.dir={tmp_path / 'run'}")
    assert trained.status == 0, trained.stderr
    metrics = json.loads((trained.folder / "metrics.json").read_text())
    assert metrics["source"] == f"{data_set}, episode 1, {FRONT} (to frame 15)"
    assert metrics["frames"] == 15
    refused = command("train", *own, f"task.path={data_set}", f"hydra.run.dir={tmp_path / 'refused'}")
    assert (refused.status, refused.stderr) == (
        2,
        f"error: {data_set}: has 3 episodes; expected task.episode=NUMBER, from 0 to 2\n",
    )

    bag = write_bag(tmp_path / "robot.mcap", {"/camera/image": [raw(frame, "rgb8") for frame in frames]})
    answered = command("infer", f"skill={trained.folder}", f"video={bag}", f"hydra.run.dir={tmp_path / 'infer'}")
    assert answered.status == 0, answered.stderr
    lines = [json.loads(line) for line in (answered.folder / "associations.jsonl").read_text().splitlines()]
    assert {line["frame"]: line["time_s"] for line in lines} == {n: pytest.approx(n / 10) for n in range(len(frames))}
    labels = {"object": [[1, 1], [159, 1], [159, 119]], "target": [[1, 1], [159, 1], [159, 119]], "hand": []}
    (tmp_path / "labels.json").write_text(json.dumps({"image_size": [160, 120], "frames": {"0": labels, "19": labels}}))
    regions = f"regions={tmp_path / 'labels.json'}"
    scored = command(
        "evaluate",
        f"skill={trained.folder}",
        f"video={data_set}",
        "episode=1",
        regions,
        f"hydra.run.dir={tmp_path / 'evaluate'}",
    )
    assert scored.status == 0, scored.stderr
    assert json.loads((scored.folder / "metrics.json").read_text())["frames"] == len(frames)
