"""MJCF files of models/: loading, attaching and compiling their specifications."""

import contextlib
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

from robosim.config.resources import folder
from robosim.errors import ConfigError


def load_spec(*parts: str) -> mujoco.MjSpec:
    """Load the specification of a file below models/, given by the parts of its path.

    Raises ConfigError where there is no such file.
    """
    path = folder("models").joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"model file {path} is missing; the installation is incomplete")
    return mujoco.MjSpec.from_file(str(path))


def read_inner_size(container: str) -> np.ndarray:
    """Read the inner size (3,) [m] of a container of models/containers.

    A box-shaped site in its file marks it.
    """
    return 2.0 * np.array(load_spec("containers", f"{container}.xml").site(f"{container}_inside").size)


@contextlib.contextmanager
def allow_empty_prefixes() -> Iterator[None]:
    """Suppress MuJoCo's warning about attaching with an empty prefix.

    All names in models/ are unique, and sensors and joints are looked up by these names.
    """
    mujoco.set_mju_user_warning(lambda text: None)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*prefix.*")
        try:
            yield
        finally:
            mujoco.set_mju_user_warning(None)


def compile_spec(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification without MuJoCo's warning about empty prefixes."""
    with allow_empty_prefixes():
        return spec.compile()
