"""The granular field of a rehearsal: its solver, its colliders, and checks of its configuration."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

import mpm
from mpm.backend import is_shared
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import accepted_bound, check_step
from robosim.base.errors import ConfigError
from robosim.config.bounds import MAX_GRAINS, MAX_SUBSTEPS
from robosim.config.materials import Law
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ContainerConfig, FieldConfig
from robosim.scene.frames import container_pose, waypoint_pose
from robosim.scene.grains import fill
from robosim.scene.models import container_shape
from robosim.shapes import MeshTool, OwnTool, ToolShape, tool_shape

TOOL_SPACING = 1e-3
"""Lattice spacing [m] of the tool's signed distance: interpolation is exact to 0.1 mm at a sixth of a wall."""
CONTAINER_SPACING = 2e-3
"""Lattice spacing [m] of a container's signed distance."""
CONTAINER_WALL = 3.0
"""Thickness of a container's collider walls, in cells, grown outward."""


REGION_MARGIN = 0.08
"""Distance [m] around containers, waypoints, pile and area to which grains are computed, where no region is given."""


class GrainField(NamedTuple):
    """The solver of a rehearsal, its tool's collider and its grains' volume."""

    solver: mpm.Solver
    tool: int
    """Index of the tool's collider."""
    grain_volume: float
    """[m^3]"""


def build_field(config: RehearsalConfig, law: Law, tool_pose: mpm.Pose, seed: int = 0) -> GrainField:
    """Build the solver of a rehearsal, with the tool at its initial world pose."""
    field = config.field
    sdf = build_tool_sdf(config.tool, config.grain_wall)
    head = tool_shape(config.tool).head_shell() if config.collision_thickness == "shell" else sdf
    # as the plugin will want it: a collider that it has to change makes the solver anew
    colliders = [mpm.Collider(head, friction=field.tool_friction, pose=tool_pose, mobile=config.coupling == "mobility")]
    colliders += build_container_colliders(config.containers, field, shells=config.shells)
    walls = {name: build_container_sdf(name, config.containers[name], field) for name in config.sources}
    positions, volume = fill(config, sdf, walls, tool_pose, np.random.default_rng(seed))
    solver = mpm.Solver(
        grid=field.grid,
        bodies=[mpm.Body(law, positions, volume=volume,
                         stress=mpm.geostatic_stress(positions, volume, law))], colliders=colliders,
        walls=mpm.Walls(friction=field.floor_friction), dt=field.dt, transfer_interval=field.transfer_interval,
        sleep=field.sleep if field.sleep is not None else not is_shared(), contact=field.contact,
    )
    return GrainField(solver, 0, volume)


def choose_region(config: RehearsalConfig) -> RehearsalConfig:
    """Return a configuration with a region of the grains: around places and motion where the file gives none."""
    if config.field.region_lower is not None:
        return config
    points = [waypoint_pose(waypoint, config.containers).position for waypoint in config.waypoints]
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        points += list(container_pose(container).apply(corners))
    for place in filter(None, (config.pile, config.area)):
        points += [np.array(place.centre) - place.half, np.array(place.centre) + place.half]
    low, high = np.min(points, axis=0) - REGION_MARGIN, np.max(points, axis=0) + REGION_MARGIN
    region = {"region_lower": (float(low[0]), float(low[1]), 0.0), "region_upper": tuple(map(float, high))}
    field = FieldConfig.model_validate(config.field.model_dump() | region)
    return config.model_copy(update={"field": field})


def build_tool_sdf(tool: str | OwnTool, thickness: float) -> Lattice:
    """Build the signed distance of a tool in its own frame.

    thickness: of its wall [m]. Raises ConfigError for a tool with holes.
    """
    check_holes(tool_shape(tool), f"wall of {thickness} m")
    return tool_shape(tool).distance(thickness, TOOL_SPACING)


def filled_volume(config: RehearsalConfig) -> float:
    """Return the volume [m^3] of the grains in a tool that is filled at the start, as they are placed."""
    sdf = build_tool_sdf(config.tool, config.grain_wall)
    positions, volume = fill(config, sdf, {}, mpm.Pose.identity(), np.random.default_rng(0))
    return volume * len(positions)


def check_holes(shape: ToolShape | MeshTool, wall: str) -> None:
    """Raise ConfigError for a tool with holes that is a solid in the field; wall: how its wall was given."""
    if shape.holes is not None:
        raise ConfigError(f"tool {shape.name!r} with a {wall}: its holes are smaller than a cell, and a solid has "
                          f"none; accepted: a task with tool_wall: shell, or another tool")


def build_container_sdf(name: str, container: ContainerConfig, field: FieldConfig) -> Lattice:
    """Build the signed distance of a container's walls, grown outward, in its own frame."""
    return container_shape(name, container).distance(CONTAINER_WALL * field.cell, CONTAINER_SPACING)


def build_container_colliders(containers: dict[str, ContainerConfig], field: FieldConfig, *, static: bool = True,
                              shells: Collection[str] = ()) -> list[mpm.Collider]:
    """Build colliders of containers; static: they never move, which makes contact cheaper.

    shells: names of those that are thin shells of their real walls, which stay where they are, too.
    """
    colliders = []
    for name, container in containers.items():
        walls = container_shape(name, container).shell() if name in shells else \
            build_container_sdf(name, container, field)
        colliders.append(mpm.Collider(walls, static=static and name not in shells, friction=field.container_friction,
                                      pose=container_pose(container)))
    return colliders


def check_field(config: RehearsalConfig, law: Law) -> None:
    """Refuse numbers that the field cannot work with, before any work.

    Raises mpm.TimeStepTooLarge for field.dt, ConfigError for fill heights that exceed container or tool, for too
    many grains or substeps, and for a region that does not hold the containers or the pile.
    """
    if config.field.dt is not None:
        check_step(config.field.dt, config.field.cell, [law], "field.dt")
    check_substeps("host_dt", config.host_dt, config.field.dt or accepted_bound(config.field.cell, law))
    _check_fill_heights(config)
    _check_count(config)
    _check_region(config)


def check_substeps(name: str, step: float, substep: float) -> None:
    """Raise ConfigError where a step [s] takes too many substeps [s]; name: of the step."""
    if step > MAX_SUBSTEPS * substep:
        raise ConfigError(f"{name} = {step} s takes {step / substep:.3g} substeps of {substep:.3g} s (field.dt, or the "
                          f"stability bound of field.cell and the material); accepted: up to {MAX_SUBSTEPS}")


def _check_count(config: RehearsalConfig) -> None:
    """Refuse more grains than a scene can have, before any is placed."""
    if config.sources:
        where, volume = f"container {' and '.join(map(repr, config.sources))}", sum(
            _filled_volume(name, config.containers[name]) for name in config.sources)
    elif config.pile is not None:
        where, volume = "pile", 8.0 * float(np.prod(config.pile.half))
    else:  # as `sample_in_tool` does, with as much height again
        where, volume = config.tool_name, 12.0 * float(np.prod(tool_shape(config.tool).interior.half))
    count = volume * config.field.grains_per_cell / config.field.cell**3
    if count > MAX_GRAINS:
        raise ConfigError(f"field.grains_per_cell = {config.field.grains_per_cell} with field.cell = "
                          f"{config.field.cell} m: {count:.3g} grains in the {where}; accepted: up to {MAX_GRAINS}")


def _filled_volume(name: str, container: ContainerConfig) -> float:
    """Volume [m^3] of the box around a container's inside, up to its fill height."""
    low, high = container_shape(name, container).bounds
    return float(np.prod((high - low)[:2])) * container.fill_height


def _check_fill_heights(config: RehearsalConfig) -> None:
    for name, container in config.containers.items():
        height = container_shape(name, container).height
        if container.fill_height > height:
            raise ConfigError(f"containers.{name}: fill_height = {container.fill_height} m; accepted: up to "
                              f"{height:.3g} m, the height of the container")
    depth = 2.0 * tool_shape(config.tool).interior.half[2]
    if config.tool_fill_height is not None and config.tool_fill_height > depth:
        raise ConfigError(f"tool_fill_height = {config.tool_fill_height} m; accepted: up to {depth:.3f} m, the height "
                          f"of the interior of the {config.tool_name}")


def _check_region(config: RehearsalConfig) -> None:
    grid = config.field.grid
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        corners = np.array([[x, y, low[2]] for x in (low[0], high[0]) for y in (low[1], high[1])])
        try:
            grid.check_inside(container_pose(container).apply(corners))
        except mpm.InvalidValue as error:
            raise ConfigError(f"field.region_lower, region_upper do not hold container {name!r}: {error}") from None
    if config.pile is not None:
        try:
            grid.check_inside(np.array(config.pile.centre) + np.array(config.pile.half) * [[-1, -1, -1], [1, 1, 1]])
        except mpm.InvalidValue as error:
            raise ConfigError(f"field.region_lower, region_upper do not hold the pile: {error}") from None
