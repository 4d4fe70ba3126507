"""Rendered demonstrations of four manipulation tasks, with ground truth that no camera provides."""

import os
import sys
from ctypes.util import find_library

# MuJoCo chooses its OpenGL backend when it is imported, and only on Linux does the default need a display. If EGL is
# missing, "disable" keeps the import working, so that only rendering fails, with a message that says what to install.
if sys.platform.startswith("linux") and "MUJOCO_GL" not in os.environ:
    os.environ["MUJOCO_GL"] = "egl" if find_library("EGL") and find_library("GL") else "disable"
