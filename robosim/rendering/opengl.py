"""Choice of the OpenGL library that MuJoCo loads, before its import."""

import ctypes
import os


def choose_graphics() -> None:
    """Set MUJOCO_GL unless the user did: to "egl" where its libraries load, otherwise to "disable".
    Without a display only EGL can draw, and importing MuJoCo fails where MUJOCO_GL names a library that is missing."""
    if "MUJOCO_GL" not in os.environ:
        try:
            for library in ("libEGL.so.1", "libGL.so.1"):
                ctypes.CDLL(library)
            os.environ["MUJOCO_GL"] = "egl"
        except OSError:
            os.environ["MUJOCO_GL"] = "disable"
