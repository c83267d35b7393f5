"""The field of a sub-task: its grains, its tool and its container."""

import numpy as np

import mpm
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import chosen_step, material_bound
from robosim.config.materials import Law
from robosim.scene.build import inner_size
from robosim.scene.fill import container_colliders, places_in_tool
from robosim.scene.frames import container_pose
from robosim.shapes import tool_shape
from robosim.tasks.task import TaskConfig

LATTICE = 4
"""Points of the tool's lattice in a cell."""


def grain_volume(task: TaskConfig) -> float:
    """[m^3] of one grain."""
    for name, container in task.containers.items():
        size = inner_size(name)
        return float(size[0] * size[1] * container.fill_height) / task.grains.count
    if task.start.pile is not None:
        return 8.0 * float(np.prod(task.start.pile.half)) / task.grains.count
    return task.field.cell**3 / task.field.grains_per_cell


def filling(task: TaskConfig, sdf: Lattice) -> np.ndarray:
    """Places [m] (count, 3) of the grains before they settle: the lowest that the tool, container or pile has."""
    spacing = grain_volume(task) ** (1.0 / 3.0)
    rng = np.random.default_rng(0)
    if task.container is not None and task.container_place is not None:
        half, container = inner_size(task.container) / 2.0, task.container_place
        upper = np.array([half[0], half[1], container.fill_height + spacing])
        places = container_pose(container).apply(mpm.sample_box(upper * [-1, -1, 0], upper, spacing, rng))
        keys = places[:, 2]
    elif task.start.pile is not None:
        centre, half = np.array(task.start.pile.centre), np.array(task.start.pile.half)
        places = mpm.sample_box(centre - half, centre + half * [1, 1, 2], spacing, rng)
        keys = places[:, 2] + 0.3 * np.linalg.norm(places[:, :2] - centre[:2], axis=1)
    else:
        region, pose = tool_shape(task.tool).interior, task.start.pose
        local = places_in_tool(task.tool, sdf, spacing, rng)
        places = pose.apply(local)
        keys = places[:, 2] + 0.6 * np.linalg.norm(local[:, :2] - np.array(region.centre)[:2], axis=1)
    if len(places) < task.grains.count:
        raise mpm.InvalidValue(f"{task.grains.count} grains of {grain_volume(task) * 1e9:.0f} mm^3 do not fit: "
                               f"{len(places)} places; accepted: at most that many grains.count")
    return places[np.argsort(keys, kind="stable")[: task.grains.count]]


def asked_step(task: TaskConfig, law: Law) -> float | None:
    """The task's substep [s], None where a law is too stiff for it: the solver then chooses its own."""
    asked = task.field.dt
    return None if asked is None or asked > material_bound(task.field.cell, law) else asked


def substep(task: TaskConfig, law: Law) -> float:
    """Largest substep [s] that a task's field takes with a law."""
    return chosen_step(asked_step(task, law), material_bound(task.field.cell, law))


def build_solver(task: TaskConfig, law: Law, *, mobile: bool = False, places: np.ndarray | None = None,
                 volume: float | None = None) -> mpm.Solver:
    """The solver with its grains as filled, not yet settled, or at places [m] (n, 3) with a grain's volume [m^3].
    mobile: contact moves the tool, too."""
    field = task.field
    sdf = mpm.Sdf.from_mesh(tool_shape(task.tool).head(task.tool_wall), spacing=field.cell / LATTICE)
    colliders = [mpm.Collider(sdf, friction=field.tool_friction, pose=task.start.pose, mobile=mobile)]
    colliders += container_colliders(task.containers, field)
    body = mpm.Body(law, filling(task, sdf) if places is None else places, volume=volume or grain_volume(task))
    return mpm.Solver(grid=mpm.Grid(field.region_lower, field.region_upper, field.cell), bodies=[body],
                      colliders=colliders, walls=mpm.Walls(friction=field.floor_friction),
                      dt=asked_step(task, law), transfer_interval=field.transfer_interval)
