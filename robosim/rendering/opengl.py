"""Which OpenGL library MuJoCo is to load; asked once, before its import."""

import ctypes
import os


def choose_graphics() -> None:
    """Set MUJOCO_GL unless the user did: "egl" where its libraries load, otherwise "disable".

    Without a display only EGL draws, and MuJoCo cannot even be imported when it is told to use a library that is
    not there.
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
