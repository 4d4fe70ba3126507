"""Weights of pretrained features: published ones, which are downloaded once, and files of the user's.

They are kept in a folder, ``GEOSKILL_WEIGHTS`` in the environment or the user's cache folder: ``disk.pt`` is the
published file, ``disk-DIGEST.pt`` a user's. A skill stores the digest, never a path, so that nothing of a checkpoint
names a file.
"""

import functools
import hashlib
import os
import re
import urllib.error
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import torch
from platformdirs import user_cache_path
from torch import Tensor, nn

from geoskill.errors import InputError, missing_extra
from geoskill.io.atomic import atomic_path

DIGEST: Final = re.compile(r"sha256:[0-9a-f]{64}")
"""How a user's weights are named in a skill."""
MAX_BYTES = 1_000_000_000

Network = TypeVar("Network", bound=nn.Module)


def named_weights(name: str, weights: str | None) -> str | None:
    """Return the name under which a skill knows weights, and keep a copy of a user's file.

    Args:
        name: of the extractor.
        weights: path of a file, or such a name; None for the published ones.

    Raises:
        InputError: when there is no such file, or it cannot be kept.
    """
    if weights is None or DIGEST.fullmatch(weights):
        return weights
    key, path = f"descriptor.{name}.weights={weights}", Path(weights)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{key}: more than {MAX_BYTES} bytes; expected weights of {name}")
        content = path.read_bytes()
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{key}: cannot be read ({getattr(error, 'strerror', error)}); expected a file") from error
    named = f"sha256:{hashlib.sha256(content).hexdigest()}"
    kept = _kept(name, named)
    if not kept.is_file():
        with atomic_path(kept) as temporary:
            temporary.write_bytes(content)
    return named


def load_network(
    name: str, weights: str | None, urls: Sequence[str], make: Callable[[], Network], prefix: str = ""
) -> Network:
    """Return a network with its weights, ready for inference; the same object for the same file.

    Args:
        name: of the extractor.
        weights: see :func:`named_weights`.
        urls: of the published weights; the first that answers is taken.
        make: makes the network.
        prefix: of the network's entries, where the file's lack it.

    Raises:
        InputError: when the weights are not there and cannot be downloaded, or are others than the network's.
    """
    path = _kept(name, weights)
    if not path.is_file():
        if weights is not None:
            raise InputError(
                f"descriptor={name}: {path} is not there; expected the weights that the skill was learned with"
            )
        _download(name, urls, path)
    return _loaded(make, prefix, str(path), path.stat().st_mtime_ns)  # type: ignore[return-value]


def kornia_feature(name: str) -> Any:
    """Return the module ``kornia.feature``.

    Raises:
        InputError: when it is not installed.
    """
    try:
        import kornia.feature
    except ImportError:
        raise missing_extra(f"descriptor={name}", "learned") from None
    return kornia.feature


@functools.lru_cache(maxsize=8)
def _loaded(make: Callable[[], nn.Module], prefix: str, path: str, _changed_ns: int) -> nn.Module:
    network = make()
    try:
        stored: Any = torch.load(path, map_location="cpu", weights_only=True)
        # DISK's authors have the weights in an entry of their training's state.
        state: Mapping[str, Tensor] = stored.get("extractor", stored)
        network.load_state_dict({f"{prefix}{key}": value for key, value in state.items()})
    except Exception as error:  # a file of another kind leads to any
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: are no weights of {type(network).__name__} ({reason}); expected them") from error
    return network.eval().requires_grad_(False)


def _download(name: str, urls: Sequence[str], path: Path) -> None:
    problem: Exception | None = None
    for url in urls:
        try:
            with atomic_path(path) as temporary:
                torch.hub.download_url_to_file(url, str(temporary), progress=False)
            return
        except (urllib.error.URLError, OSError, RuntimeError) as error:
            problem = error
    raise InputError(
        f"descriptor={name}: its weights cannot be downloaded from {urls[0]} ({problem}); expected a network, or the"
        f" file as descriptor.{name}.weights=PATH"
    ) from problem


def _kept(name: str, weights: str | None) -> Path:
    chosen = os.environ.get("GEOSKILL_WEIGHTS")
    try:
        folder = Path(chosen) if chosen else user_cache_path("geoskill") / "weights"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:  # the latter of a user without a home folder
        raise InputError(
            f"descriptor={name}: no folder for weights ({error}); expected GEOSKILL_WEIGHTS=DIR"
        ) from error
    return folder / (f"{name}.pt" if weights is None else f"{name}-{weights.removeprefix('sha256:')}.pt")
