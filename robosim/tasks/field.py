"""The MPM field of a sub-task: its grains, its tool and its container."""

import functools
import warnings

import numpy as np

import mpm
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import accepted_bound, choose_step
from robosim.base.errors import ConfigError
from robosim.config.materials import Law
from robosim.scene.field import build_container_colliders, check_holes, check_substeps
from robosim.scene.frames import container_pose
from robosim.scene.grains import sample_in_tool
from robosim.scene.models import container_shape
from robosim.shapes import MeshTool, ToolShape, tool_shape
from robosim.shapes.containers import BoxShape
from robosim.tasks.task import RECEIVER, TaskConfig

TOOL_SDF_POINTS = 4
"""Points of the tool's sampled signed distance along a cell."""


@functools.lru_cache(maxsize=8)
def head_distance(shape: ToolShape | MeshTool, wall: float, spacing: float) -> Lattice:
    """Return the signed distance of a tool's head with walls of `wall` [m], at points `spacing` [m] apart."""
    return shape.head_distance(wall, spacing)


@functools.lru_cache(maxsize=8)
def head_shell(shape: ToolShape | MeshTool) -> mpm.Shell:
    """Return a tool's head as a thin shell; raises ConfigError for a tool that has none."""
    return shape.head_shell()


def field_head(task: TaskConfig) -> Lattice | mpm.Shell:
    """Return the head of a task's tool as its field has it: a solid's signed distance, or a thin shell."""
    return head_shell(tool_shape(task.tool)) if task.tool_wall == "shell" else filling_head(task)


def head_orifices(task: TaskConfig, grain_diameter: float | None) -> list[mpm.Orifice]:
    """Return the small holes of the head of a task's tool, for grains of a diameter [m].

    grain_diameter: None for materials to which the law of small holes does not apply. Raises ConfigError for a tool
    with holes and such a material, and for one that is not a shell in the field.
    """
    shape = tool_shape(task.tool)
    if task.tool_wall != "shell":
        check_holes(shape, f"tool_wall of {task.tool_wall} m")
    if shape.holes is not None and grain_diameter is None:
        raise ConfigError(f"tool {shape.name!r} with a material without grain_diameter, by which its holes let grains "
                          f"pass, or with cohesion, by which grains arch over them; accepted: salt, sugar, sand, "
                          f"glass_beads, or a file of one's own with that key and cohesion 0")
    return [] if grain_diameter is None else shape.orifices(grain_diameter)


def filling_head(task: TaskConfig) -> Lattice:
    """Return the signed distance of the head of a task's tool as its grains are placed on it.

    A shell has the wall of a grain's spacing here, so that the places above it are found by steps of half of that.
    """
    wall = task.field.cell / task.field.grains_per_cell ** (1.0 / 3.0) if task.tool_wall == "shell" else task.tool_wall
    return head_distance(tool_shape(task.tool), wall, task.field.cell / TOOL_SDF_POINTS)


def grain_volume(task: TaskConfig) -> float:
    """Return the volume of one grain [m^3]."""
    for name, container in task.containers.items():
        return container_shape(name, container).filled_volume(container.fill_height) / task.grains.count
    if task.start.pile is not None:
        return 8.0 * float(np.prod(task.start.pile.half)) / task.grains.count
    return task.field.cell**3 / task.field.grains_per_cell


def fill_positions(task: TaskConfig, tool: Lattice, slope_deg: float = 0.0) -> np.ndarray:
    """Place the grains before they settle: positions [m] (count, 3) in the world.

    They are the lowest sites that the tool, container or pile has. tool: its signed distance. slope_deg: of the
    surface along the x axis of container or pile. Raises mpm.InvalidValue where the grains do not fit.
    """
    spacing = grain_volume(task) ** (1.0 / 3.0)
    rng, slope = np.random.default_rng(0), float(np.tan(np.radians(slope_deg)))
    if task.container is not None and task.container_place is not None:
        container = task.container_place
        shape = container_shape(task.container, container)
        low, high = shape.bounds
        rise = 0.5 * abs(slope) * (high[0] - low[0])
        upper = np.array([high[0], high[1], low[2] + container.fill_height + rise + spacing])
        local = mpm.sample_box(low, upper, spacing, rng)
        if not isinstance(shape, BoxShape):  # the rounded edges of a box push out the few grains in them
            local = local[shape.between_walls(local)]
        sites = container_pose(container).apply(local)
        keys = sites[:, 2] - slope * (local[:, 0] - 0.5 * (low[0] + high[0]))
    elif task.start.pile is not None:
        centre, half = np.array(task.start.pile.centre), np.array(task.start.pile.half)
        sites = mpm.sample_box(centre - half, centre + half * [1, 1, 2], spacing, rng)
        keys = sites[:, 2] + 0.3 * np.linalg.norm(sites[:, :2] - centre[:2], axis=1)  # a heap, not a slab
        keys -= slope * (sites[:, 0] - centre[0])
    else:
        region, pose = tool_shape(task.tool).interior, task.start.pose
        local = sample_in_tool(task.tool, tool, spacing, rng)
        sites = pose.apply(local)
        keys = sites[:, 2] + 0.6 * np.linalg.norm(local[:, :2] - np.array(region.centre)[:2], axis=1)
    if len(sites) < task.grains.count:
        raise mpm.InvalidValue(f"{task.grains.count} grains of {grain_volume(task) * 1e9:.0f} mm^3 do not fit: "
                               f"{len(sites)} places; accepted: at most that many grains.count")
    return sites[np.argsort(keys, kind="stable")[: task.grains.count]]


def requested_step(task: TaskConfig, law: Law) -> float | None:
    """Return the task's own substep [s]; None where the law is too stiff for it and the solver chooses."""
    dt = task.field.dt
    return None if dt is None or dt > accepted_bound(task.field.cell, law) else dt


def largest_step(task: TaskConfig, law: Law) -> float:
    """Return the largest substep [s] that a task's field takes with a law."""
    return choose_step(requested_step(task, law), task.field.cell, [law])


def build_solver(task: TaskConfig, law: Law, *, mobile: bool = False, positions: np.ndarray | None = None,
                 volume: float | None = None, dt: float | None = None, moves_containers: bool = False,
                 grain_diameter: float | None = None) -> mpm.Solver:
    """Build the solver with its grains as filled, not yet settled.

    mobile: contact moves the tool, too. positions [m] (n, 3) and volume [m^3] of a grain: in place of the task's own.
    dt: substep [s]; None: the task's own. moves_containers: whether containers can be put to other places.
    grain_diameter: [m] of the material, which a tool with small holes needs.
    """
    field = task.field
    check_substeps("step_dt", task.step_dt, largest_step(task, law))
    colliders = [mpm.Collider(field_head(task), friction=field.tool_friction, pose=task.start.pose, mobile=mobile,
                              orifices=head_orifices(task, grain_diameter))]
    colliders += build_container_colliders(task.containers, field, static=not moves_containers)
    if task.receiver is not None:
        colliders.append(mpm.Collider(container_shape(RECEIVER, task.receiver).shell(),
                                      friction=field.container_friction, pose=container_pose(task.receiver)))
    grains = fill_positions(task, filling_head(task)) if positions is None else positions
    body = mpm.Body(law, grains, volume=volume or grain_volume(task))
    with warnings.catch_warnings():
        if positions is not None:  # grains that have flowed stand in no lattice any more
            warnings.simplefilter("ignore", mpm.VolumeMismatch)
        return mpm.Solver(grid=field.grid, bodies=[body],
                          colliders=colliders, walls=mpm.Walls(friction=field.floor_friction),
                          dt=dt or requested_step(task, law), transfer_interval=field.transfer_interval,
                          sleep=field.sleep or False, contact=field.contact)
