"""``servo.jsonl`` of ``servo.py``."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.cli.servo_log import ServoLog
from geoskill.errors import InputError
from geoskill.exports.exporter import open_exports
from geoskill.exports.names import exporters_of
from tests.exports.test_files import read_bag

Command = Callable[..., Any]


def steps_in(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "servo.jsonl").read_text(encoding="utf-8").splitlines()]


def test_steps_of_trials_are_there_and_exports_take_them(command: Command, tmp_path: Path) -> None:
    run = ["plant=points", "faults=none", f"hydra.run.dir={tmp_path}"]
    assert command("servo", *run, "trials=1").status == 0
    first = steps_in(tmp_path)
    assert {step["trial"] for step in first} == {0}
    assert [step["frame"] for step in first] == list(range(len(first)))
    assert (first[0]["state"], first[-1]["state"], first[0]["twist_frame"]) == ("explore", "done", "base")
    assert np.shape(first[-1]["rows"][0]["jacobian"]) == (2, 4)
    # A line of a trial that was not completed is dropped when the run goes on.
    with (tmp_path / "servo.jsonl").open("a", encoding="utf-8") as file:
        file.write(json.dumps({"trial": 1, "frame": 0}) + '\n{"trial": 1, "fr')
    assert command("servo", *run, "trials=2").status == 0
    both = steps_in(tmp_path)
    assert both[: len(first)] == first
    assert {step["trial"] for step in both[len(first) :]} == {1}
    with open_exports(exporters_of(["ros2", "visp"], tmp_path)) as exports:
        for step in first:
            exports.add(step)
    twists = read_bag(tmp_path / "error.mcap")["/geoskill/twist"]
    assert [own.twist.linear.x for _, _, own in twists] == [step["twist"][0] for step in first]
    features = json.loads((tmp_path / "visp_features.json").read_text(encoding="utf-8"))["frames"][-1]["features"]
    assert np.shape(features[0]["L"]) == (2, 6)
    assert [line[3:5] for line in features[0]["L"]] == [[0.0, 0.0]] * 2  # neither roll nor pitch is commanded


def test_damaged_lines_are_refused(tmp_path: Path) -> None:
    (tmp_path / "servo.jsonl").write_text('{"frame": 0}\n', encoding="utf-8")
    with pytest.raises(InputError, match=r"servo.jsonl: cannot be read \('trial'\); expected another hydra.run.dir"):
        ServoLog(tmp_path, 1)
    assert (tmp_path / "servo.jsonl").read_text(encoding="utf-8") == '{"frame": 0}\n'
