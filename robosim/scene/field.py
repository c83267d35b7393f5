"""The granular field of a rehearsal: its solver, its colliders, and checks of its configuration."""

from typing import NamedTuple

import numpy as np

import mpm
from mpm.backend import is_shared
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import accepted_bound, check_step
from robosim.config.bounds import MAX_GRAINS, MAX_SUBSTEPS
from robosim.config.materials import Law
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import ContainerConfig, FieldConfig
from robosim.errors import ConfigError
from robosim.scene.frames import container_pose
from robosim.scene.grains import fill
from robosim.scene.models import read_inner_size
from robosim.shapes import tool_shape
from robosim.shapes.vessels import make_container_shell

TOOL_SPACING = 1e-3
"""Lattice spacing [m] of the tool's signed distance: interpolation is exact to 0.1 mm at a sixth of a wall."""
CONTAINER_SPACING = 2e-3
"""Lattice spacing [m] of a container's signed distance."""
CONTAINER_WALL = 3.0
"""Thickness of a container's collider walls, in cells, grown outward."""


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
    sdf = build_tool_sdf(config.tool, config.collision_thickness)
    # as the plugin will want it: a collider that it has to change makes the solver anew
    colliders = [mpm.Collider(sdf, friction=field.tool_friction, pose=tool_pose, mobile=config.coupling == "mobility")]
    colliders += build_container_colliders(config.containers, field)
    positions, volume = fill(config, sdf, tool_pose, np.random.default_rng(seed))
    solver = mpm.Solver(
        grid=mpm.Grid(field.region_lower, field.region_upper, field.cell),
        bodies=[mpm.Body(law, positions, volume=volume,
                         stress=mpm.geostatic_stress(positions, volume, law))], colliders=colliders,
        walls=mpm.Walls(friction=field.floor_friction), dt=field.dt, transfer_interval=field.transfer_interval,
        sleep=field.sleep if field.sleep is not None else not is_shared(),
    )
    return GrainField(solver, 0, volume)


def build_tool_sdf(tool: str, thickness: float) -> Lattice:
    """Build the signed distance of a tool in its own frame.

    thickness: of its wall [m].
    """
    return mpm.Sdf.from_mesh(tool_shape(tool).solid(thickness), spacing=TOOL_SPACING)


def build_container_colliders(containers: dict[str, ContainerConfig], field: FieldConfig) -> list[mpm.Collider]:
    """Build static colliders of containers, by their names in models/containers."""
    colliders = []
    for name, container in containers.items():
        shell = make_container_shell(read_inner_size(name), wall=CONTAINER_WALL * field.cell)
        colliders.append(mpm.Collider(mpm.Sdf.from_mesh(shell, spacing=CONTAINER_SPACING), static=True,
                                      friction=field.container_friction, pose=container_pose(container)))
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
    if config.source is not None:
        size = read_inner_size(config.source)
        where, volume = f"container {config.source!r}", size[0] * size[1] * config.containers[config.source].fill_height
    elif config.pile is not None:
        where, volume = "pile", 8.0 * float(np.prod(config.pile.half))
    else:  # as `sample_in_tool` does, with as much height again
        where, volume = f"{config.tool}", 12.0 * float(np.prod(tool_shape(config.tool).interior.half))
    count = volume * config.field.grains_per_cell / config.field.cell**3
    if count > MAX_GRAINS:
        raise ConfigError(f"field.grains_per_cell = {config.field.grains_per_cell} with field.cell = "
                          f"{config.field.cell} m: {count:.3g} grains in the {where}; accepted: up to {MAX_GRAINS}")


def _check_fill_heights(config: RehearsalConfig) -> None:
    for name, container in config.containers.items():
        height = read_inner_size(name)[2]
        if container.fill_height > height:
            raise ConfigError(f"containers.{name}: fill_height = {container.fill_height} m; accepted: up to {height} "
                              f"m, the height of the container")
    depth = 2.0 * tool_shape(config.tool).interior.half[2]
    if config.tool_fill_height is not None and config.tool_fill_height > depth:
        raise ConfigError(f"tool_fill_height = {config.tool_fill_height} m; accepted: up to {depth:.3f} m, the height "
                          f"of the interior of the {config.tool}")


def _check_region(config: RehearsalConfig) -> None:
    grid = mpm.Grid(config.field.region_lower, config.field.region_upper, config.field.cell)
    for name, container in config.containers.items():
        half = read_inner_size(name) / 2.0
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
