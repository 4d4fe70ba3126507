"""When the associations of a member come to their end in the demonstration, which gives the order of a task."""

from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True)
class Settling:
    """From when on the associations that a member selects in its demonstration are where they end.

    Attributes:
        share: of the demonstration after which they stay there, in [0, 1].
        threshold: norm of what their errors differ by from those at the end, below which they are there; in the unit
            of the error.
        error_at_end: median norm of the error itself over the last tenth of the demonstration.
    """

    share: float
    threshold: float
    error_at_end: float
