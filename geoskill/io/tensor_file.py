"""Files of ``torch.save`` from anybody: plain values and tensors, no more of them than the file holds.

``torch.load(weights_only=True)`` imports and runs nothing of a file, but lets it ask for any amount of memory: entries
that inflate, objects made by size (``bytearray(10**12)``), views that repeat one number a billion times, lists that
hold each other. What is read here is at most as large as the file, and a tree.
"""

import pickletools
import re
import zipfile
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch

from geoskill.io.archive import require_uninflated

# Of the part without tensors. Every byte of it may become an object of some 70 bytes.
MAX_PLAIN_BYTES = 16_000_000
MAX_DEPTH = 32
_CLASSES = re.compile(r"torch \w+Storage|torch\._utils _rebuild_tensor_v2|collections OrderedDict")


def load_tensors(path: Path) -> Any:
    """Return the contents of a file: dictionaries, lists and tuples of plain values and dense tensors on the CPU.

    Raises:
        OSError: when the file cannot be read.
        ValueError: when it is no file of ``torch.save``, or holds anything else or more than its size allows.
    """
    size = path.stat().st_size
    plain_bytes = _require_bounded(path, size)
    try:
        contents = torch.load(path, map_location="cpu", weights_only=True)
    except OSError:
        raise
    except Exception as error:  # a broken archive raises anything from EOFError to UnpicklingError
        raise ValueError("it is broken") from error
    tensor_bytes = 0
    for count, value in enumerate(_tree(contents, MAX_DEPTH), start=1):
        if count > plain_bytes:  # in a tree, every value takes a byte
            raise ValueError("values contain each other")
        if isinstance(value, torch.Tensor):
            _require_dense(value)
            tensor_bytes += value.nbytes
    if tensor_bytes > size:
        raise ValueError(f"tensors take {tensor_bytes} bytes, the file {size}")
    return contents


def _require_bounded(path: Path, size: int) -> int:
    """Return the size of the part without tensors, which names nothing but tensors and dictionaries.

    Raises:
        ValueError: when an entry inflates, there is no such part, it is too large, or it names something else.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            require_uninflated(archive, size)
            plain = [entry for entry in archive.infolist() if entry.filename.endswith("/data.pkl")]
            if len(plain) != 1 or plain[0].file_size > MAX_PLAIN_BYTES:
                raise ValueError(f"the values take more than {MAX_PLAIN_BYTES} bytes, or there are none")
            pickled = archive.read(plain[0])
            for operation, argument, _ in pickletools.genops(pickled):
                known = operation.name not in ("STACK_GLOBAL", "INST", "EXT1", "EXT2", "EXT4")
                if not known or (operation.name == "GLOBAL" and not _CLASSES.fullmatch(str(argument))):
                    raise ValueError(f"it names {str(argument)[:60]!r}")
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise ValueError("it is broken") from error
    return len(pickled)


def _tree(value: Any, depth: int) -> Iterator[Any]:
    """Yield a value and all values in it.

    Raises:
        ValueError: when one is neither plain nor a tensor, or they are nested too deeply.
    """
    if depth == 0:
        raise ValueError(f"values are nested more than {MAX_DEPTH} deep")
    yield value
    if type(value) is dict or (type(value) is OrderedDict and vars(value).keys() <= {"_metadata"}):
        for key, entry in value.items():
            yield from _tree(key, depth - 1)
            yield from _tree(entry, depth - 1)
    elif type(value) in (list, tuple):
        for entry in value:
            yield from _tree(entry, depth - 1)
    elif type(value) not in (bool, int, float, str, type(None), torch.Tensor):
        raise ValueError(f"it holds a {type(value).__name__}")


def _require_dense(tensor: torch.Tensor) -> None:
    if tensor.layout is not torch.strided or tensor.device.type != "cpu":
        raise ValueError(f"a tensor is {tensor.layout} on {tensor.device}")
    if tensor.nbytes > tensor.untyped_storage().nbytes():
        raise ValueError(f"a tensor of {tensor.nbytes} bytes is made of {tensor.untyped_storage().nbytes()}")
