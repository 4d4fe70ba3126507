"""Errors that a user can mend, told apart from faults of the program.

Raise :class:`InputError` for anything the user gave (a file, a key, a value): the commands print its message as one
line and exit with status 2. Every other exception is a failure in the middle of work and exits with status 1.
"""

from typing import final


@final
class InputError(ValueError):
    """Something the user gave is unusable; the message names it and says what was expected."""
