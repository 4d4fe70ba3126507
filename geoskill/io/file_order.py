"""The order of files whose names have numbers in them.

``2.png`` comes before ``10.png``. Names made of times, ``1700000000.0333333.jpg``, are ordered by their decimal value,
in which a program that writes them may have left out trailing zeros. But ``1.9.png`` and ``1.10.png`` may as well be
the ninth and the tenth picture of the first part; what such names look like decides, and is said.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from decimal import Decimal

# Runs of digits with single dots between them, such as 7, 7.5 or 2024.01.05; as Python writes it, an exponent.
NUMBERS = re.compile(r"([0-9]+(?:\.[0-9]+)*(?:e[-+][0-9]+(?![0-9a-z]))?)")
DECIMAL = re.compile(r"([0-9]+)\.([0-9]+)(?:e[-+][0-9]+)?|[0-9]+e-[0-9]+")


def in_order(stems: Iterable[str]) -> tuple[list[str], str | None]:
    """Return names without their endings in the order of their numbers, and how they were read if that is ambiguous.

    >>> in_order(["10", "2"])
    (['2', '10'], None)
    >>> in_order(["t0.5", "t0.0666", "t0.25"])
    (['t0.0666', 't0.25', 't0.5'], None)
    >>> in_order(["1.10", "1.9", "1.1"])[0]
    ['1.1', '1.9', '1.10']
    """
    by_part = sorted(stems, key=_by_part)
    by_value = sorted(by_part, key=_by_value)
    if by_part == by_value:
        return by_part, None
    fractions = list(_fractions(by_part))
    if _is_decimal(fractions) and not _is_counter(fractions):
        return by_value, None
    if _is_counter(fractions) and not _is_decimal(fractions):
        return by_part, _told(by_part, "parts", "decimal numbers")
    return by_value, _told(by_value, "decimal numbers", "parts")


def _by_part(stem: str) -> tuple[list[str | int], str]:
    # The captured group puts numbers at odd positions, so that words are never compared with numbers.
    tokens = re.split(r"([0-9]+)", stem.lower())
    return [int(token) if position % 2 else token for position, token in enumerate(tokens)], stem


def _by_value(stem: str) -> tuple[list[tuple[str, Sequence[Decimal]]], str]:
    texts, numbers = (NUMBERS.split(stem.lower())[start::2] for start in (0, 1))
    # Of three and more, as of a date, each is a number of its own.
    values = [[Decimal(part) for part in ([run] if DECIMAL.fullmatch(run) else _parts(run))] for run in numbers]
    return [*zip(texts, [*values, []], strict=True)], stem


def _parts(run: str) -> list[str]:
    return re.findall(r"[0-9]+", run)


def _fractions(stems: Iterable[str]) -> Iterator[str]:
    for stem in stems:
        for run in NUMBERS.findall(stem.lower()):
            match = DECIMAL.fullmatch(run)
            if match is not None and match[2] is not None:
                yield match[2]


def _is_decimal(fractions: Sequence[str]) -> bool:
    """Return whether a fraction begins with a zero, as no counter does that is written with more or fewer digits."""
    return any(len(fraction) > 1 and fraction[0] == "0" for fraction in fractions)


def _is_counter(fractions: Sequence[str]) -> bool:
    """Return whether a fraction ends with a zero, as none does that is written with more or fewer digits."""
    return any(len(fraction) > 1 and fraction[-1] == "0" for fraction in fractions)


def _told(order: Sequence[str], read_as: str, instead_of: str) -> str:
    example = next(stem for stem in order if any(True for _ in _fractions([stem])))
    return (
        f"numbers such as that of {example!r} are read as {read_as}, not as {instead_of}:"
        f" the order is {', '.join(order[:3])}, …; expected names with equally many digits"
    )
