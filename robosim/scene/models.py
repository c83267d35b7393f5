"""Models of a scene, bundled or of one's own: containers, tools, and arm, hand and tool put together."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.resources import folder
from robosim.config.arm import ArmConfig, GripperConfig
from robosim.config.scene import ContainerConfig
from robosim.config.table import Placement
from robosim.config.tool import ToolConfig, load_bundled
from robosim.robot.assembly import Assembly, ToolModel
from robosim.robot.hand import load_hand, load_hand_model
from robosim.robot.mjspec import read_model
from robosim.robot.robot import load_arm, load_robot_model
from robosim.shapes import tool_shape
from robosim.shapes.containers import BoxShape, ContainerShape, RoundShape, read_container
from robosim.shapes.rigid_models import add_container_body, build_tool_spec


def load_spec(*parts: str) -> mujoco.MjSpec:
    """Load the specification of a file below models/, by the parts of its path; raises ConfigError for none."""
    path = folder("models").joinpath(*parts)
    if not path.is_file():
        raise ConfigError(f"model file {path} is missing; the installation is incomplete")
    return mujoco.MjSpec.from_file(str(path))


@lru_cache
def read_inner_size(container: str) -> tuple[float, float, float]:
    """Read the inner size (3,) [m] of a container of models/containers. A box-shaped site in its file marks it."""
    x, y, z = 2.0 * np.array(load_spec("containers", f"{container}.xml").site(f"{container}_inside").size)
    return float(x), float(y), float(z)


def container_shape(name: str, container: ContainerConfig) -> ContainerShape:
    """Return the shape of a container by its name and configuration; raises ConfigError for a wrong mesh."""
    if container.mesh is not None:
        return read_container(container.mesh, container.thickness, container.scale)
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
        spec = mujoco.MjSpec()
        add_container_body(spec, name, container_shape(name, container))
        return spec
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


def load_tool_model(tool: str | ToolConfig) -> ToolModel:
    """Load the body of a tool of models/tools, or of one of one's own; raises ConfigError."""
    config = load_bundled(tool) if isinstance(tool, str) else tool
    name, grip = config.name, f"{config.name}_grip"
    spec = build_tool_spec(tool_shape(tool)) if config.model is None else read_model(Path(config.model))
    if spec.body(name) is None or spec.site(grip) is None:
        raise ConfigError(f"{config.model}: has no body {name!r} with a site {grip!r}; accepted: an MJCF file of the "
                          f"tool's body")
    return ToolModel(name, spec, grip)


def assemble(tool: str | ToolConfig | None, robot: str | ArmConfig = "iiwa14",
             gripper: str | GripperConfig | None = None, grip_turn_deg: float = 0.0,
             base: Placement | None = None) -> Assembly:
    """Put together an arm, a hand and a tool by their names, files or tables.
    tool None: an empty hand; gripper None: the arm's usual hand; base: where the arm stands, None: where its file says.
    Paths in tables are absolute, or relative to the working directory. Raises ConfigError, UnknownName."""
    arm = load_arm(robot) if isinstance(robot, str) else load_robot_model(robot, Path())
    gripper = arm.gripper if gripper is None else gripper
    hand = load_hand(gripper) if isinstance(gripper, str) else load_hand_model(gripper, Path())
    if base is not None:
        arm = replace(arm, stand=base.pose)
    return Assembly(arm, hand, None if tool is None else load_tool_model(tool), grip_turn_deg)
