"""Learn a manipulation skill from one video by inferring which geometric features belong together."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geoskill.skill.skill import Skill
    from geoskill.skill.temporal_filter import TemporalFilter

__all__ = ["Skill", "TemporalFilter"]


def __getattr__(name: str) -> Any:
    # The commands print their help before anything as heavy as PyTorch is imported.
    if name == "Skill":
        from geoskill.skill.skill import Skill

        return Skill
    if name == "TemporalFilter":
        from geoskill.skill.temporal_filter import TemporalFilter

        return TemporalFilter
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
