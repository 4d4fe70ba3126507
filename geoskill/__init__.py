"""Learn a manipulation skill from one video by inferring which geometric features belong together."""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geoskill.config import TrainConfig
    from geoskill.plugins import register
    from geoskill.skill.servoing import Servo
    from geoskill.skill.skill import Skill
    from geoskill.skill.temporal_filter import TemporalFilter
    from geoskill.training.learn import LearnedSkill, learn

# A picture of a few kilobytes may unfold to gigabytes. OpenCV reads its limit, here 8K, when it is imported.
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(2**25))

__all__ = ["LearnedSkill", "Servo", "Skill", "TemporalFilter", "TrainConfig", "learn", "register"]

_HOME = {
    "LearnedSkill": "geoskill.training.learn",
    "Servo": "geoskill.skill.servoing",
    "Skill": "geoskill.skill.skill",
    "TemporalFilter": "geoskill.skill.temporal_filter",
    "TrainConfig": "geoskill.config",
    "learn": "geoskill.training.learn",
    "register": "geoskill.plugins",
}


def __getattr__(name: str) -> Any:
    # The commands print their help before anything as heavy as PyTorch is imported.
    if name in _HOME:
        return getattr(import_module(_HOME[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
