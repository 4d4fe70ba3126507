"""The machine that a benchmark runs on."""

import platform
from typing import Any

import torch

from geoskill.errors import InputError


def check_run(repeats: int, device: str) -> None:
    """Refuse a number of rounds or a device that cannot be used.

    Raises:
        InputError: when ``repeats`` is below 1 or there is no such device.
    """
    if repeats < 1:
        raise InputError(f"repeats={repeats}: expected at least 1")
    if device not in ("cpu", "cuda"):
        raise InputError(f"device={device}: expected cpu or cuda")
    if device == "cuda" and not torch.cuda.is_available():
        raise InputError("device=cuda: PyTorch finds no GPU here; expected device=cpu")


def describe_machine(device: str, threads: int, repeats: int) -> dict[str, Any]:
    """Return the conditions of a measurement, for JSON: processor, GPU, threads, PyTorch's version and rounds."""
    return {
        "processor": platform.processor() or platform.machine(),
        "gpu": torch.cuda.get_device_name() if device == "cuda" else None,
        "threads": threads,
        "torch": torch.__version__,
        "repeats": repeats,
    }
