"""Errors that a user can mend, told apart from faults of the program.

Raise :class:`InputError` for anything the user gave (a file, a key, a value): the commands print its message as one
line and exit with status 2. Every other exception is a failure in the middle of work and exits with status 1.
"""

import reprlib
from typing import final

_SHORT = reprlib.Repr()
_SHORT.maxstring = _SHORT.maxother = 80
_SHORT.maxlevel = 3


def shown(value: object) -> str:
    """Return a value for a message, shortened where it is long: what it came with may be from anybody.

    >>> shown({"a": list(range(100))})
    "{'a': [0, 1, 2, 3, 4, 5, ...]}"
    """
    return _SHORT.repr(value)


def missing_extra(what: str, extra: str) -> "InputError":
    """Return the error of what needs packages that are installed on demand.

    >>> str(missing_extra("bag.mcap", "ros2"))
    "bag.mcap: needs packages that are not installed; expected pip install 'geoskill[ros2]'"
    """
    return InputError(f"{what}: needs packages that are not installed; expected pip install 'geoskill[{extra}]'")


@final
class InputError(ValueError):
    """Something the user gave is unusable; the message names it and says what was expected."""
