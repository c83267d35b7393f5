"""Models of a scene: those of models/, and containers of one's own."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.resources import folder
from robosim.config.scene import ContainerConfig
from robosim.shapes.containers import BoxShape, ContainerShape, RoundShape, read_container
from robosim.shapes.rigid_models import build_container_spec


def load_spec(*parts: str) -> mujoco.MjSpec:
    """Load the specification of a file below models/, given by the parts of its path.

    Raises ConfigError where there is no such file.
    """
    path = folder("models").joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"model file {path} is missing; the installation is incomplete")
    return mujoco.MjSpec.from_file(str(path))


@lru_cache
def read_inner_size(container: str) -> tuple[float, float, float]:
    """Read the inner size (3,) [m] of a container of models/containers.

    A box-shaped site in its file marks it.
    """
    x, y, z = 2.0 * np.array(load_spec("containers", f"{container}.xml").site(f"{container}_inside").size)
    return float(x), float(y), float(z)


def container_shape(name: str, container: ContainerConfig) -> ContainerShape:
    """Return the shape of a container by its name and configuration; raises ConfigError for a wrong mesh."""
    if container.mesh is not None:
        return read_container(container)  # pyright: ignore[reportArgumentType]  (its mesh is given)
    if container.radius is not None and container.height is not None:
        return make_shape(RoundShape, container.radius, container.height, container.wall)
    if container.size is not None:
        return make_shape(BoxShape, container.size, container.wall)
    return make_shape(BoxShape, read_inner_size(container.model or name))


@lru_cache(maxsize=64)
def make_shape(kind: Callable[..., ContainerShape], *sizes: Any) -> ContainerShape:
    """Make a shape of sizes; one of equal sizes is the same object."""
    return kind(*sizes)


def load_container(name: str, container: ContainerConfig) -> mujoco.MjSpec:
    """Return the specification of a container, whose body is called `name`."""
    if not container.is_named:
        return build_container_spec(name, container_shape(name, container))
    model = container.model or name
    spec = load_spec("containers", f"{model}.xml")
    if model != name:
        for part in (*spec.bodies, *spec.geoms, *spec.sites, *spec.meshes, *spec.materials):
            if part.name.startswith(model):
                part.name = name + part.name.removeprefix(model)
        for geom in spec.geoms:
            for key in ("meshname", "material"):
                if getattr(geom, key).startswith(model):
                    setattr(geom, key, name + getattr(geom, key).removeprefix(model))
    return spec
