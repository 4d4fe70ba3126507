"""Whether what the configuration holds can be worked with, told by the name of the key."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from geoskill.errors import InputError

# Values of several kinds, which Lightning checks itself.
FREE = ("trainer.devices", "trainer.precision")
# Where null switches something off.
OPTIONAL = (
    "demonstration.max_visible_features",
    "early_stopping.patience",
    "model.cascade",
    "model.encoder_dim",
    "model.prototypes",
    "trainer.gradient_clip_val",
    "trainer.limit_train_batches",
    "ema_decay",
)
# What is expected where the default does not tell: it is null, or one of two kinds of numbers.
EXAMPLES = {
    "seed": 0,
    "threads": 2,
    "frame_rate": 30.0,
    "demonstration.max_visible_features": 50,
    "precision": "float32",
    "model.cascade": 2048,
    "task.frame_rate": 30.0,
    "trainer.limit_train_batches": 25.0,
    "trainer.gradient_clip_val": 1.0,
    "early_stopping.patience": 8,
    "ema_decay": 0.99,
}
# A whole number counts, a fraction is a share: neither may become the other.
COUNT_OR_SHARE = ("trainer.limit_train_batches",)


def check_kinds(cfg: DictConfig) -> None:
    """Compare every value with the default that it replaces, and make a whole number a float where that is one.

    Raises:
        InputError: when it is of another kind, such as a word for a number.
    """
    loader = GlobalHydra.instance().config_loader()
    groups = set(loader.list_groups(""))
    # What the command line sets besides groups is what is checked.
    chosen = [override for override in HydraConfig.get().overrides.task if override.split("=")[0] in groups]
    defaults = loader.load_configuration(HydraConfig.get().job.config_name, chosen, RunMode.RUN)
    given = dict(_leaves(OmegaConf.to_container(cfg)))
    for key, default in _leaves(OmegaConf.to_container(defaults)):
        if key in given and key not in FREE:
            check_kind(key, given[key], default)
            real = isinstance(EXAMPLES.get(key) if default is None else default, float) and key not in COUNT_OR_SHARE
            if isinstance(given[key], int) and real:
                OmegaConf.update(cfg, key, float(given[key]))


def check_kind(key: str, value: Any, default: Any) -> None:
    """Compare one value with its default.

    Raises:
        InputError: when it is of another kind.

    >>> check_kind("seed", 1, 0)
    >>> check_kind("seed", "one", 0)
    Traceback (most recent call last):
    geoskill.errors.InputError: seed=one: expected a whole number such as 0
    """
    optional = key in OPTIONAL or default is None
    example = EXAMPLES.get(key, default)
    if (value is None and optional) or example is None:
        return
    number = isinstance(value, int | float) and not isinstance(value, bool)
    match example:
        case bool():
            fits, expected = isinstance(value, bool), "true or false"
        case int():
            fits, expected = number and isinstance(value, int), f"a whole number such as {example}"
        case float():
            fits, expected = number, f"a number such as {example:g}"
        case str():
            fits, expected = isinstance(value, str), f"a word such as {example}"
        case _:
            fits, expected = isinstance(value, list), f"a list such as {example}"
    if not fits:
        alternative = " or null" if optional else ""
        raise InputError(f"{key}={'null' if value is None else value}: expected {expected}{alternative}")


@contextmanager
def refusing(node: str) -> Iterator[None]:
    """Lay it to a node of the configuration when building from it fails.

    Raises:
        InputError: for what the block raises about types and values.
    """
    try:
        yield
    except (TypeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{node}: {error}") from error


def _leaves(node: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(node, dict):
        yield prefix, node
        return
    for key, value in node.items():
        if not (prefix == "" and key == "hydra"):
            yield from _leaves(value, f"{prefix}.{key}" if prefix else str(key))
