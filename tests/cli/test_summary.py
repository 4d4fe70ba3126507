"""What every command says at its end."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from geoskill.cli.summary import FILES, accuracy_line, confidence_line, decidability_line, files_in, script

Command = Callable[..., Any]


def test_lines() -> None:
    known: dict[str, Any] = {"frames": 20, "frames_with_association": 15, "mean_confidence": 0.834}
    known |= {"top1_accuracy": 0.9, "feasible_frames": 10}
    assert confidence_line(known) == "confidence: 0.83 on average; something is selected in 15 of 20 frames"
    assert accuracy_line(known) == "accuracy: 90.0% of 10 labeled frames (top 1)"
    nothing = {"frames": 20, "frames_with_association": 0, "mean_confidence": None}
    assert confidence_line(nothing) == "confidence: nothing is selected in any of 20 frames"
    assert accuracy_line(nothing) is None


def test_decidability_line() -> None:
    camera = {"determined": 3, "of": 4, "free": ["the turn"], "weak": [{"motion": "z", "mm": 21.04, "deg": 0.0}]}
    assert decidability_line({"decidability": {"one_camera": camera, "decidable": "no"}}) == (
        "determined by one camera, all associations together: 3 of 4 (x, y, z, and the turn about the vertical);"
        " free: the turn; weak: z (21 mm, 0.0°); decidable: no"
    )
    whole = {"determined": 4, "of": 4, "free": [], "weak": []}
    line = decidability_line({"decidability": {"one_camera": whole, "decidable": "yes"}})
    assert line == (
        "determined by one camera, all associations together: 4 of 4 (x, y, z, and the turn about the vertical);"
        " decidable: yes"
    )
    assert decidability_line({}) is None
    assert decidability_line({"decidability": None}) is None


def test_commands_to_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.argv", ["some/where/train.py"])
    assert script("infer", "skill=Bob's run") == """python some/where/infer.py 'skill=Bob'"'"'s run'"""
    monkeypatch.setattr("sys.argv", ["/usr/bin/geoskill-train"])
    assert script("infer", "skill=a") == "geoskill-infer skill=a"


def test_training_ends_with_a_summary(trained: Any) -> None:
    lines = trained.stdout.strip().splitlines()
    assert lines[-1] == str(trained.folder)
    files = lines[lines.index("files:") + 1 : lines.index("next:") - 1]
    assert [line.split()[0] for line in files] == [name for name in FILES if (trained.folder / name).exists()]
    there = {path.name for path in trained.folder.iterdir() if path.name[0] != "." and path.suffix != ".log"}
    assert there == {line.split()[0] for line in files}
    following = [line.split("  #")[0].split() for line in lines[lines.index("next:") + 1 : -2]]
    assert [own[1] for own in following] == ["infer.py", "evaluate.py"]
    assert all(f"skill={trained.folder}" in own for own in following)
    assert any(line.startswith("confidence: ") for line in lines)
    epochs = [line for line in lines if line.startswith("training: epoch")]
    assert [re.sub(r"objective \S+, \d+ s", "", line) for line in epochs] == [
        f"training: epoch {epoch} of 2,  left" for epoch in (1, 2)
    ]
    assert "extracting features: 20" in lines
    assert lines.index("training: 2 epochs") == lines.index(epochs[0]) - 1


def test_infer_ends_with_a_summary(
    command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path, tiny: Sequence[str]
) -> None:
    ended = command("infer", f"skill={skill}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path}")
    assert ended.status == 0, ended.stderr
    lines = ended.stdout.splitlines()
    assert lines[-1] == str(tmp_path)
    assert files_in(tmp_path) == lines[lines.index("files:") + 1 : lines.index("next:") - 1]
