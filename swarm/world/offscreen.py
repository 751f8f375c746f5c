"""The choice of a graphics library that draws without a screen, which MuJoCo takes when it is loaded."""

import ctypes.util
import os
import sys

LIBRARIES = (("egl", "EGL"), ("osmesa", "OSMesa"))
"""What MuJoCo can draw with on Linux without a screen: the value of MUJOCO_GL, and the library's name."""


def choose() -> None:
    """Choose a library where nobody has. It has an effect only before the first import of mujoco."""
    if "MUJOCO_GL" in os.environ or not sys.platform.startswith("linux"):
        return
    for value, library in LIBRARIES:
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = value
            return
