"""Files of tensors from anybody: what they hold takes no more memory than they are large, and is a tree."""

import io
import pickle
import resource
import sys
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.io.tensor_file import MAX_DEPTH, MAX_PLAIN_BYTES, load_tensors


class Calls:
    """What asks the reader to call a function."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
        self.function, self.arguments = function, arguments

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return self.function, self.arguments


def archive(path: Path, pickled: bytes, compression: int = zipfile.ZIP_STORED, **more: bytes) -> Path:
    with zipfile.ZipFile(path, "w", compression) as writer:
        for name, content in {"data.pkl": pickled, "version": b"3\n", "byteorder": b"little", **more}.items():
            writer.writestr(f"archive/{name}", content)
    return path


def nested(depth: int, width: int = 1) -> list[Any]:
    value: list[Any] = [1]
    for _ in range(depth):
        value = [value] * width
    return value


def test_plain_values_and_tensors_are_read(tmp_path: Path) -> None:
    contents = {
        "weights": OrderedDict(a=torch.arange(6.0).reshape(2, 3), b=torch.tensor(1.5, dtype=torch.bfloat16)),
        "rows": [{"step": 1, "rsw": 0.5}, {"step": 2, "rsw": float("nan")}],
        "plain": (True, None, "text", 2**70, -0.0),
    }
    torch.save(contents, tmp_path / "a.ckpt")
    read = load_tensors(tmp_path / "a.ckpt")
    assert read["plain"] == contents["plain"]
    assert repr(read) == repr(contents)


@pytest.mark.parametrize(
    ("contents", "message"),
    [
        ({"a": torch.zeros(1).expand(10**9)}, "a tensor of 4000000000 bytes is made of 4"),
        ({"a": torch.arange(1000.0), "b": [torch.zeros(10).expand(3, 10)]}, "a tensor of 120 bytes is made of 40"),
        ([torch.ones(10_000)] * 9, r"tensors take 360000 bytes, the file \d+"),
        ({"a": torch.zeros(3).to_sparse()}, "it names 'torch"),
        ({"a": torch.zeros(10**9, device="meta")}, "it names 'torch"),
        ({"a": torch.nn.Parameter(torch.zeros(2))}, "it names 'torch._utils _rebuild_parameter'"),
        ({"a": b"bytes"}, "it names '_codecs encode'"),
        ({"a": {1, 2}}, "it names '(__builtin__|builtins) set'"),
        ({"a": torch.Size([1])}, "it names 'torch Size'"),
        (nested(40, 10), "values contain each other|values are nested more than"),
        (nested(20, 10), "values contain each other"),
        (nested(MAX_DEPTH), f"values are nested more than {MAX_DEPTH} deep"),
    ],
)
def test_more_than_the_file_holds_is_refused(contents: Any, message: str, tmp_path: Path) -> None:
    torch.save(contents, tmp_path / "a.ckpt")
    with pytest.raises(ValueError, match=f"^{message}"):
        load_tensors(tmp_path / "a.ckpt")


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (Calls(bytearray, 10**12), "bytearray"),
        (Calls(torch.Tensor, 10**12), "torch._tensor Tensor|torch Tensor"),
        (Calls(print, "called"), "print"),
        (Calls(__import__, "this"), "__import__"),
    ],
)
def test_nothing_is_called(value: Calls, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = archive(tmp_path / "a.ckpt", pickle.dumps({"a": value}, protocol=2))
    with pytest.raises(ValueError, match=f"^it names '.*({name})'$"):
        load_tensors(path)
    assert capsys.readouterr().out == ""


def test_a_list_that_holds_itself_is_refused(tmp_path: Path) -> None:
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(ValueError, match=r"^values (contain each other|are nested)"):
        load_tensors(archive(tmp_path / "a.ckpt", pickle.dumps(endless, protocol=2)))


def test_attributes_of_a_dictionary_are_refused(tmp_path: Path) -> None:
    shadowed: OrderedDict[str, int] = OrderedDict(a=1)
    vars(shadowed)["more"] = 5
    torch.save(shadowed, tmp_path / "a.ckpt")
    with pytest.raises(ValueError, match=r"^it holds a OrderedDict$"):
        load_tensors(tmp_path / "a.ckpt")


@pytest.mark.parametrize("protocol", [4, 5])
def test_other_protocols_are_refused(protocol: int, tmp_path: Path) -> None:
    path = archive(tmp_path / "a.ckpt", pickle.dumps({"a": Calls(bytearray, 10**12)}, protocol=protocol))
    with pytest.raises(ValueError, match=r"^(it names|it is broken)"):
        load_tensors(path)


def test_an_archive_that_inflates_is_refused_before_it_does(tmp_path: Path) -> None:
    pickled = pickle.dumps({"a": "a" * 3_000_000}, protocol=2)
    path = archive(tmp_path / "a.ckpt", pickled, zipfile.ZIP_DEFLATED)
    with pytest.raises(ValueError, match=r"^an entry is compressed$"):
        load_tensors(path)


def test_entries_that_share_their_bytes_are_refused(tmp_path: Path) -> None:
    """As in a bomb without compression: the directory lists one stretch of the file many times."""
    path = archive(tmp_path / "a.ckpt", pickle.dumps({}, protocol=2), **{"data/0": b"0" * 1000})
    with zipfile.ZipFile(path, "a") as writer:
        entry = writer.getinfo("archive/data/0")
        writer.filelist += [entry] * 20
        writer._didModify = True  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=r"^the entries are larger than the file$"):
        load_tensors(path)


def test_many_values_are_refused(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.ckpt", b"\x80\x02" + b"}" * MAX_PLAIN_BYTES + b".")
    with pytest.raises(ValueError, match=f"^the values take more than {MAX_PLAIN_BYTES} bytes"):
        load_tensors(path)


@pytest.mark.parametrize("content", [b"", b"PK", b"no archive", pickle.dumps({"state_dict": {}})])
def test_other_files_are_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.ckpt").write_bytes(content)
    with pytest.raises(ValueError, match=r"^it is broken$"):
        load_tensors(tmp_path / "a.ckpt")


def test_files_of_older_versions_of_pytorch_are_refused(tmp_path: Path) -> None:
    """They are no archives, and say themselves how much memory they take."""
    buffer = io.BytesIO()
    torch.save({"a": torch.zeros(3)}, buffer, _use_new_zipfile_serialization=False)
    (tmp_path / "a.ckpt").write_bytes(buffer.getvalue())
    with pytest.raises(ValueError, match=r"^it is broken$"):
        load_tensors(tmp_path / "a.ckpt")


@pytest.mark.skipif(sys.platform != "linux", reason="the peak is in kilobytes on Linux")
def test_refusing_takes_no_memory(tmp_path: Path) -> None:
    torch.save({"a": torch.zeros(1).expand(10**9)}, tmp_path / "a.ckpt")
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match="is made of 4"):
        load_tensors(tmp_path / "a.ckpt")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000
