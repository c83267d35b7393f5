"""The field of a rehearsal: grains in their container, the tool and the containers as colliders."""

from typing import NamedTuple

import numpy as np

import mpm
from mpm.sdf import Lattice
from robosim.config import MaterialConfig, RehearsalConfig
from robosim.frames import container_pose
from robosim.scene import Scene
from robosim.tool_shapes import container_shell, spoon_components

TOOL_SPACING = 1e-3
"""Lattice spacing [m] of the tool's signed distance: a sixth of a wall keeps trilinear values exact to 0.1 mm."""
CONTAINER_SPACING = 2e-3
CONTAINER_WALL = 3.0
"""Thickness of a container's walls as the grains see them, in cells, grown outward."""
MAX_TOOL_SPEED = 2.0
"""[m/s] that the time step allows for; a rehearsal that is faster is refused by the joint limits."""


class Grains(NamedTuple):
    """A solver and how its colliders are counted."""

    solver: mpm.Solver
    tool: int
    """Index of the tool's collider."""
    containers: dict[str, int]
    """Name -> index of the container's collider."""
    grain_volume: float
    """[m^3] per particle."""


def material(config: MaterialConfig) -> mpm.DruckerPrager:
    """The law of a configured material."""
    return mpm.DruckerPrager(E=config.E.value, nu=config.nu.value, density=config.density.value,
                             friction_angle_deg=config.friction_angle.value, cohesion=config.cohesion.value)


def tool_sdf(tool: str, thickness: float) -> Lattice:
    """Signed distance of a tool in its own frame, with a wall of `thickness` [m]."""
    shapes = {"spoon": spoon_components}
    return mpm.Sdf.from_mesh(shapes[tool](thickness), spacing=TOOL_SPACING)


def fill(config: RehearsalConfig, scene: Scene, rng: np.random.Generator) -> tuple[np.ndarray, float]:
    """Grain positions [m] (n, 3) in all filled containers, and the volume [m^3] of one."""
    spacing = config.field.cell / config.field.grains_per_cell ** (1.0 / 3.0)
    positions, volume = [], 0.0
    for name, container in config.containers.items():
        if container.fill_height == 0:
            continue
        half = scene.inner_size(name) / 2.0
        upper = np.array([half[0], half[1], container.fill_height])
        local = mpm.sample_box(upper * [-1, -1, 0], upper, spacing, rng)
        volume = float(4.0 * np.prod(upper)) / len(local)
        positions.append(container_pose(container).apply(local))
    if not positions:
        raise mpm.InvalidValue("no container is filled: give one a fill_height above 0")
    return np.concatenate(positions), volume


def build(config: RehearsalConfig, law: mpm.DruckerPrager, scene: Scene, tool_pose: mpm.Pose,
          seed: int = 0) -> Grains:
    """The solver of a rehearsal, with the tool where the arm starts."""
    field = config.field
    colliders = [mpm.Collider(tool_sdf(config.tool, config.collision_thickness), friction=field.tool_friction,
                              pose=tool_pose)]
    containers = {}
    for name, container in config.containers.items():
        shell = container_shell(scene.inner_size(name), wall=CONTAINER_WALL * field.cell)
        containers[name] = len(colliders)
        colliders.append(mpm.Collider(mpm.Sdf.from_mesh(shell, spacing=CONTAINER_SPACING), static=True,
                                      friction=field.container_friction, pose=container_pose(container)))
    positions, volume = fill(config, scene, np.random.default_rng(seed))
    solver = mpm.Solver(
        grid=mpm.Grid(field.region_lower, field.region_upper, field.cell),
        bodies=[mpm.Body(law, positions, volume=volume)], colliders=colliders,
        walls=mpm.Walls(friction=field.floor_friction), dt=field.dt, max_speed=MAX_TOOL_SPEED,
    )
    return Grains(solver, 0, containers, volume)
