"""The kernels and networks that the benchmarks go through by name."""

from geoskill.cli.compose import compose_training
from geoskill.errors import InputError
from geoskill.kernels.kernel import Kernel
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.plugins import KERNELS, SCORERS
from geoskill.schema import as_plain

PRESETS = ("default", "paper", "bilinear", "prototypes")
"""Choices of ``model=``."""


def kernel_of(name: str) -> Kernel:
    """Build the kernel of a name.

    Raises:
        InputError: when there is none.
    """
    kernel: Kernel = KERNELS.build(name, {})()
    return kernel


def network_arguments(preset: str) -> dict[str, object]:
    """Return name and arguments of a network, as ``model=`` chooses it.

    Raises:
        InputError: when there is none.
    """
    if preset not in (*PRESETS, *SCORERS.names()):
        raise InputError(f"models={preset}: expected some of {', '.join(PRESETS)}")
    arguments: dict[str, object] = as_plain(compose_training(f"model={preset}").model)
    return arguments


def build_network(arguments: dict[str, object], motif: Motif) -> InstanceScorer:
    """Build a network from its name and arguments."""
    plain = dict(arguments)
    network: InstanceScorer = SCORERS.build(str(plain.pop("name")), plain)(motif)
    return network
