"""What the demonstration itself says of what was learned from it: whether the selected features came together there."""

from dataclasses import dataclass
from typing import Any, Final, final

MIN_APPROACHED: Final = 0.5
"""Share of the frames from which on something was learned (docs/experiments/evidence.md)."""


@final
@dataclass(frozen=True)
class Evidence:
    """How far the associations that a member selects in its demonstration are known to have come together.

    Attributes:
        approached: share of the frames whose best association is known to have lost much of its error by the end, in
            [0, 1].
        end_over_start: median over these frames of the error's norm at the end over that before; 1 without any.
        approaching: median over the frames of the number of instances that are known to have come closer at all.
    """

    approached: float
    end_over_start: float
    approaching: float

    @property
    def found(self) -> bool:
        """Whether the selected associations came together; otherwise nothing was learned."""
        return self.approached >= MIN_APPROACHED

    @property
    def reliance(self) -> float:
        """Factor of the confidence of all associations, in [0, 1]: 1 where something was found."""
        return min(1.0, self.approached / MIN_APPROACHED)

    def as_plain(self) -> dict[str, Any]:
        """Return the metrics as written to ``metrics.json`` and ``skill.yaml``."""
        return {
            "found": self.found,
            "approached": round(self.approached, 4),
            "end_over_start": round(self.end_over_start, 4),
            "approaching_instances": self.approaching,
        }

    def __str__(self) -> str:
        share = f"{self.approached:.0%} of the frames"
        if self.found:
            return f"the selected features come together in {share}, to {self.end_over_start:.0%} of their distance"
        return f"nothing was learned: the selected features are known to come together in {share} only"
