"""Rendered demonstrations of four tasks, with the ground truth that a camera cannot give."""

import os
import sys

# MuJoCo reads it while it is imported. Only on Linux does its default need a display.
if sys.platform.startswith("linux"):
    os.environ.setdefault("MUJOCO_GL", "egl")
