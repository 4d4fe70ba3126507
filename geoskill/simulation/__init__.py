"""Rendered demonstrations of four tasks, with the ground truth that a camera cannot give."""

import os
import sys
from ctypes.util import find_library

# MuJoCo reads it while it is imported. Only on Linux does its default need a display. Where EGL is missing, the import
# would fail; switched off, it is only the rendering that does, and that says what to install.
if sys.platform.startswith("linux") and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if find_library("EGL") and find_library("GL") else "disable"
