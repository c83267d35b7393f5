"""Choice of the OpenGL library that MuJoCo loads, before its import."""

import ctypes
import os


def choose_graphics() -> None:
    """Set MUJOCO_GL unless the user did.

    To "egl" where its libraries load, otherwise to "disable". Without a display only EGL can draw, and importing MuJoCo
    fails where MUJOCO_GL names a library that is missing.
    """
    if "MUJOCO_GL" in os.environ:
        return
    try:
        for library in ("libEGL.so.1", "libGL.so.1"):
            ctypes.CDLL(library)
    except OSError:
        os.environ["MUJOCO_GL"] = "disable"
    else:
        os.environ["MUJOCO_GL"] = "egl"
