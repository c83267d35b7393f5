"""Choice of the OpenGL library that MuJoCo loads, before its import, and the answer where it cannot be loaded."""

import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

from robosim.base.errors import ConfigError


class NamesMissingGraphics:
    """An import hook: where MuJoCo's import of what draws fails, ConfigError says so."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None,
                  ) -> ModuleSpec | None:
        """Give MuJoCo's own spec, whose loader names a library that is missing; None for any other module."""
        spec = PathFinder.find_spec(fullname, path) if fullname == "mujoco" else None
        if spec is None or spec.loader is None:
            return None
        load = spec.loader.exec_module

        def load_or_refuse(module: ModuleType) -> None:
            try:
                load(module)
            except (AttributeError, ImportError, RuntimeError) as error:
                import traceback

                places = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]
                if not any(place.endswith("gl_context.py") for place in places):
                    raise
                raise ConfigError(f"MUJOCO_GL={os.environ['MUJOCO_GL']}: cannot be loaded ({error}); accepted: "
                                  f"disable, or egl, osmesa or glfw where that is installed") from None

        spec.loader.exec_module = load_or_refuse
        return spec


def choose_graphics() -> None:
    """Set MUJOCO_GL unless the user did: to "egl" where its libraries load, otherwise to "disable".
    Without a display only EGL can draw, and importing MuJoCo fails where MUJOCO_GL names a library that is missing:
    ConfigError then."""
    sys.meta_path.insert(0, NamesMissingGraphics())
    if "MUJOCO_GL" not in os.environ:
        import ctypes  # here, so that `import robosim` is light where the user chose

        try:
            for library in ("libEGL.so.1", "libGL.so.1"):
                ctypes.CDLL(library)
            os.environ["MUJOCO_GL"] = "egl"
        except OSError:
            os.environ["MUJOCO_GL"] = "disable"
