"""``make data``, from an archive on this machine: nothing is fetched from anywhere else."""

import hashlib
import io
import sys
import tarfile
from pathlib import Path

import pytest

from geoskill.cli import data
from geoskill.cli.data import SEQUENCES, fetch
from geoskill.errors import InputError

FRAMES = {1: b"first", 2: b"second", 10: b"third"}  # by number, not by letter
WANTED = {"blocks/human1": ("Dataset/Blocks/human1", 3, hashlib.sha256(b"firstsecondthird").hexdigest())}


def archive(path: Path, frames: dict[int, bytes]) -> str:
    contents = {f"Dataset/Blocks/human1/raw_{number}.jpg": frame for number, frame in frames.items()}
    contents |= {"Dataset/Blocks/human1/combine.jpg": b"all of them", "Dataset/Other/human1/raw_1.jpg": b"other"}
    contents |= {"../../evil/raw_1.jpg": b"evil", "README.md": b"text"}
    with tarfile.open(path, "w:gz") as tar:
        for name, content in contents.items():
            member = tarfile.TarInfo(f"state-representation-robotics-04e381d/{name}")
            member.size = len(content)
            tar.addfile(member, io.BytesIO(content))
    return path.as_uri()


def test_frames_are_written_in_order_and_nothing_else(tmp_path: Path) -> None:
    url = archive(tmp_path / "a.tar.gz", FRAMES)
    assert fetch(tmp_path / "data", url, WANTED) == ["blocks/human1"]
    written = sorted((tmp_path / "data").rglob("*.*"))
    assert [(path.name, path.read_bytes()) for path in written] == [
        ("0000.jpg", b"first"),
        ("0001.jpg", b"second"),
        ("0002.jpg", b"third"),
    ]
    assert fetch(tmp_path / "data", "file:///no/such/archive", WANTED) == ["blocks/human1"]  # it is there


def test_other_frames_are_refused(tmp_path: Path) -> None:
    url = archive(tmp_path / "a.tar.gz", {**FRAMES, 2: b"changed"})
    with pytest.raises(InputError, match=r"human1 has 3 frames with the digest .*; expected 3 with"):
        fetch(tmp_path / "data", url, WANTED)
    assert not (tmp_path / "data").exists()


def test_no_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["data", str(tmp_path / "data")])
    monkeypatch.setattr(data, "ARCHIVE", "http://127.0.0.1:9/a.tar.gz")
    with pytest.raises(SystemExit) as ended:
        data.main()
    assert ended.value.code == 2
    output = capsys.readouterr()
    assert "license: free of charge" in output.out
    assert output.err.startswith("error: http://127.0.0.1:9/a.tar.gz: cannot be fetched (")
    assert output.err.endswith("expected a network that reaches it\n")
    assert output.err.count("\n") == 1


def test_damaged_archive(tmp_path: Path) -> None:
    path = tmp_path / "a.tar.gz"
    archive(path, FRAMES)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(InputError, match="damaged or cut off"):
        fetch(tmp_path / "data", path.as_uri(), WANTED)


def test_digests_are_those_of_the_demonstrations(blocks: Path) -> None:
    for name in ("human1", "robot1"):
        frames = [path.read_bytes() for path in sorted((blocks / name).glob("*.jpg"))]
        _, count, digest = SEQUENCES[f"blocks/{name}"]
        assert (len(frames), hashlib.sha256(b"".join(frames)).hexdigest()) == (count, digest)
