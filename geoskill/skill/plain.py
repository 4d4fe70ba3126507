"""Plain values of a checkpoint, with their types checked."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from geoskill.errors import InputError, shown


def mapping_of(value: object, where: str, keys: Sequence[str] | None = None) -> dict[str, Any]:
    """Return a mapping of a checkpoint, with these keys and no others where they are given.

    Raises:
        InputError: when it is something else.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"the skill's {where} is {shown(value)}; expected names with values")
    if keys is not None and set(value) != set(keys):
        raise InputError(f"the skill's {where} has {', '.join(map(str, value))[:200]}; expected {', '.join(keys)}")
    return dict(value)


def text_of(value: object, where: str) -> str:
    """Return a text of a checkpoint.

    Raises:
        InputError: when it is something else.
    """
    if not isinstance(value, str):
        raise InputError(f"the skill's {where} is {shown(value)}; expected text")
    return value


def require_plain(value: object, where: str) -> None:
    """Refuse tensors among the values of a checkpoint.

    Raises:
        InputError: when there is one, however deep.
    """
    if isinstance(value, torch.Tensor):
        raise InputError(f"the skill's {where} holds a tensor; expected plain values")
    if isinstance(value, Mapping | list | tuple):
        for entry in value.values() if isinstance(value, Mapping) else value:
            require_plain(entry, where)
