"""Rendered demonstrations of six manipulation tasks, with ground truth that no camera provides."""

import os
import sys
from ctypes.util import find_library

# Those with which MuJoCo can be imported, and the libraries that they need for it; others name a window system.
_LIBRARIES = {"egl": ("EGL", "GL"), "osmesa": ("OSMesa",)}
_OTHERS = ("", "glx", "glfw", "enable", "enabled", "on", "true", "1", "disable", "disabled", "off", "false", "0")

REQUESTED_GL = os.environ.get("MUJOCO_GL")
"""OpenGL backend that the user has asked for, or None."""


def has_libraries(backend: str) -> bool:
    """Return whether MuJoCo can be imported with an OpenGL backend, such as ``egl``."""
    return backend in _OTHERS or all(find_library(name) for name in _LIBRARIES.get(backend, ("no such backend",)))


# MuJoCo chooses its OpenGL backend when it is imported, and only on Linux does the default need a display. If the
# backend is missing, "disable" keeps the import working, so that only rendering fails, with a message that says why.
if sys.platform.startswith("linux"):
    if REQUESTED_GL is None:
        os.environ["MUJOCO_GL"] = "egl" if has_libraries("egl") else "disable"
    elif not has_libraries(REQUESTED_GL.lower().strip()):
        os.environ["MUJOCO_GL"] = "disable"
        import mujoco  # noqa: F401

        os.environ["MUJOCO_GL"] = REQUESTED_GL  # as the user's, for processes that this one starts
