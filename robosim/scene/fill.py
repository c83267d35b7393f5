"""The field of a rehearsal: grains in their container, in the tool or on the table, and what they meet."""

from typing import NamedTuple

import numpy as np

import mpm
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import material_bound
from robosim.config.materials import Law
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ContainerConfig, FieldConfig
from robosim.errors import ConfigError
from robosim.scene.build import inner_size
from robosim.scene.frames import container_pose
from robosim.shapes import tool_shape
from robosim.shapes.container import container_shell

TOOL_SPACING = 1e-3
"""Lattice spacing [m] of the tool's signed distance: a sixth of a wall keeps trilinear values exact to 0.1 mm."""
CONTAINER_SPACING = 2e-3
CONTAINER_WALL = 3.0
"""Thickness of a container's walls as the grains see them, in cells, grown outward."""


class Grains(NamedTuple):
    """A solver and how its colliders are counted."""

    solver: mpm.Solver
    tool: int
    """Index of the tool's collider."""
    grain_volume: float
    """[m^3] per particle."""


def tool_sdf(tool: str, thickness: float) -> Lattice:
    """Signed distance of a tool in its own frame, with a wall of `thickness` [m]."""
    return mpm.Sdf.from_mesh(tool_shape(tool).solid(thickness), spacing=TOOL_SPACING)


def container_colliders(containers: dict[str, ContainerConfig], field: FieldConfig) -> list[mpm.Collider]:
    """Containers by the names of their models, as the grains meet them."""
    colliders = []
    for name, container in containers.items():
        shell = container_shell(inner_size(name), wall=CONTAINER_WALL * field.cell)
        colliders.append(mpm.Collider(mpm.Sdf.from_mesh(shell, spacing=CONTAINER_SPACING), static=True,
                                      friction=field.container_friction, pose=container_pose(container)))
    return colliders


def check(config: RehearsalConfig, law: Law) -> None:
    """Refuse numbers that the field cannot work with, before any work: step, fill height, region."""
    cell, dt = config.field.cell, config.field.dt
    bound = material_bound(cell, law)
    if dt is not None and dt > bound:
        raise mpm.TimeStepTooLarge(dt, bound, "isolated particle; field.dt")
    for name, container in config.containers.items():
        height = inner_size(name)[2]
        if container.fill_height > height:
            raise ConfigError(f"containers.{name}: fill_height = {container.fill_height} m; the container is {height} "
                              f"m high")
    inside = 2.0 * tool_shape(config.tool).interior.half[2]
    if config.tool_fill_height is not None and config.tool_fill_height > inside:
        raise ConfigError(f"tool_fill_height = {config.tool_fill_height} m; accepted: up to {inside:.3f} m, the height "
                          f"of what the {config.tool} holds")
    grid = mpm.Grid(config.field.region_lower, config.field.region_upper, cell)
    for name, container in config.containers.items():
        half = inner_size(name) / 2.0
        corners = np.array([[x, y, 0.0] for x in (-half[0], half[0]) for y in (-half[1], half[1])])
        try:
            grid.check_inside(container_pose(container).apply(corners))
        except mpm.InvalidValue as error:
            raise ConfigError(f"field.region_lower, region_upper do not hold container {name!r}: {error}") from None
    if config.pile is not None:
        try:
            grid.check_inside(np.array(config.pile.centre) + np.array(config.pile.half) * [[-1, -1, -1], [1, 1, 1]])
        except mpm.InvalidValue as error:
            raise ConfigError(f"field.region_lower, region_upper do not hold the pile: {error}") from None


def fill(config: RehearsalConfig, sdf: Lattice, tool_pose: mpm.Pose,
         rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Grain positions [m] (n, 3) where the material is at the start, and the volume [m^3] of one. sdf: the tool's."""
    spacing = config.field.cell / config.field.grains_per_cell ** (1.0 / 3.0)
    if config.source is not None:
        container, half = config.containers[config.source], inner_size(config.source) / 2.0
        upper = np.array([half[0], half[1], container.fill_height])
        local = mpm.sample_box(upper * [-1, -1, 0], upper, spacing, rng)
        return container_pose(container).apply(local), float(4.0 * np.prod(upper)) / len(local)
    if config.pile is not None:
        centre, half = np.array(config.pile.centre), np.array(config.pile.half)
        places = mpm.sample_box(centre - half, centre + half, spacing, rng)
        return places, float(8.0 * np.prod(half)) / len(places)
    region = tool_shape(config.tool).interior
    local = places_in_tool(config.tool, sdf, spacing, rng)
    local = local[local[:, 2] < region.centre[2] - region.half[2] + (config.tool_fill_height or 0.0)]
    if not len(local):
        raise ConfigError(f"tool_fill_height = {config.tool_fill_height} m holds no grain; accepted: more than a cell, "
                          f"{config.field.cell} m")
    return tool_pose.apply(local), spacing**3


def places_in_tool(tool: str, sdf: Lattice, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Places [m] (n, 3), in the tool's frame and about `spacing` apart, at which it would hold grains: inside it, and
    as high again above."""
    region = tool_shape(tool).interior
    centre, half = np.array(region.centre), np.array(region.half)
    local = mpm.sample_box(centre - half, centre + half * [1, 1, 2], spacing, rng)
    return local[(sdf.distance(local) > 0.5 * spacing) & _above(local, sdf, spacing)]


def _above(points: np.ndarray, sdf: Lattice, spacing: float) -> np.ndarray:
    """Whether the tool lies below points (n, 3) in its frame: what is beside it would fall past it."""
    below = np.zeros(len(points), bool)
    for drop in np.arange(spacing, 0.1, spacing / 2):
        below |= sdf.distance(points - [0.0, 0.0, drop]) < 0.0
    return below


def build(config: RehearsalConfig, law: Law, tool_pose: mpm.Pose, seed: int = 0) -> Grains:
    """The solver of a rehearsal, with the tool where the arm starts."""
    field = config.field
    sdf = tool_sdf(config.tool, config.collision_thickness)
    colliders = [mpm.Collider(sdf, friction=field.tool_friction, pose=tool_pose)]
    colliders += container_colliders(config.containers, field)
    positions, volume = fill(config, sdf, tool_pose, np.random.default_rng(seed))
    solver = mpm.Solver(
        grid=mpm.Grid(field.region_lower, field.region_upper, field.cell),
        bodies=[mpm.Body(law, positions, volume=volume)], colliders=colliders,
        walls=mpm.Walls(friction=field.floor_friction), dt=field.dt, transfer_interval=field.transfer_interval,
    )
    return Grains(solver, 0, volume)
