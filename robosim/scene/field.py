"""The granular field of a scene: its solver, its colliders, and checks of its configuration."""

import math
import warnings
from functools import lru_cache
from typing import NamedTuple

import numpy as np

import mpm
from mpm.backend import is_shared
from mpm.geometry.sampled_sdf import Lattice
from mpm.materials.stable_step import accepted_bound, check_step, choose_step
from robosim.base.errors import ConfigError
from robosim.config.bounds import MAX_GRAINS, MAX_SUBSTEPS
from robosim.config.materials import Law
from robosim.config.rehearsal import RehearsalConfig
from robosim.config.scene import FieldConfig
from robosim.config.scene_config import SceneConfig
from robosim.config.tool import ToolConfig
from robosim.scene.grains import CONTAINER_SPACING, CONTAINER_WALL, Filling, fill, grain_volume
from robosim.scene.models import container_shape
from robosim.shapes import ToolShape, tool_shape

TOOL = 0
"""Index of the tool's collider in the solver of a scene."""
TOOL_SPACING = 1e-3
"""Lattice spacing [m] of the tool's signed distance: interpolation is exact to 0.1 mm at a sixth of a wall."""
HEAD_POINTS = 4
"""Points of the lattice of a tool's head along a cell, where its handle is left out."""
FITTED = 1.02
"""By how much a substep may exceed its default, 0.75 of the bound, where that saves one in each advance."""
REGION_MARGIN = 0.08
"""Distance [m] around containers, waypoints, pile and area to which grains are computed, where no region is given."""


class FieldOptions(NamedTuple):
    """How the field of a scene is used."""

    seed: int = 0
    """Of the grains' places."""
    is_carried: bool = True
    """Whether an arm carries the tool, so that contact moves it where the scene's coupling says so."""
    moves_containers: bool = False
    """Whether containers can be put to other places; those that never move make contact cheaper."""
    grain_diameter: float | None = None
    """[m] of the material, which a tool with small holes needs; None: the law of small holes does not apply to it."""
    grains: Filling | None = None
    """In place of the scene's own."""
    dt: float | None = None
    """Substep [s]; None: the scene's own."""


def build_field(scene: SceneConfig, law: Law, tool_pose: mpm.Pose,
                options: FieldOptions = FieldOptions()) -> mpm.Solver:  # noqa: B008  (immutable)
    """Build the solver of a scene, with the tool at its initial world pose and the grains where they are placed.
    They begin under their own weight, unless the scene comes to rest first. Raises ConfigError for a tool with holes
    that is a solid, or whose material grain_diameter is missing."""
    field, tool = scene.field, build_tool_lattice(scene)
    head = tool_shape(scene.tool).head_shell if scene.tool_wall == "shell" else tool
    # as the plugin will want it: a collider that it has to change makes the solver anew
    colliders = [mpm.Collider(head, friction=field.tool_friction, pose=tool_pose,
                              mobile=options.is_carried and scene.coupling == "mobility",
                              orifices=head_orifices(scene, options.grain_diameter))]
    colliders += build_container_colliders(scene, static=not options.moves_containers)
    grains = options.grains or fill(scene, tool, tool_pose, options.seed)
    stress = None if scene.COMES_TO_REST else mpm.geostatic_stress(grains.positions, grains.volume, law)
    dt = options.dt or choose_substep(scene, law, grains.volume)
    sleeps = not (scene.COMES_TO_REST or is_shared()) if field.sleep is None else field.sleep
    with warnings.catch_warnings():
        if options.grains is not None:  # grains that have flowed stand in no lattice any more
            warnings.simplefilter("ignore", mpm.VolumeMismatch)
        return mpm.Solver(grid=field.grid, bodies=[mpm.Body(law, grains.positions, volume=grains.volume,
                                                            stress=stress)],
                          colliders=colliders, walls=mpm.Walls(friction=field.floor_friction), dt=dt,
                          transfer_interval=field.transfer_interval, sleep=sleeps)


def build_tool_lattice(scene: SceneConfig) -> Lattice:
    """Build the signed distance of a scene's tool in its own frame, as its grains are placed on it."""
    if scene.HAS_HANDLE:
        return build_tool_sdf(scene.tool, scene.solid_wall)
    return head_distance(tool_shape(scene.tool), scene.solid_wall, scene.field.cell / HEAD_POINTS)


@lru_cache(maxsize=8)
def head_distance(shape: ToolShape, wall: float, spacing: float) -> Lattice:
    """Return the signed distance of a tool's head with walls of `wall` [m], at points `spacing` [m] apart."""
    return shape.head_distance(wall, spacing)


def head_orifices(scene: SceneConfig, grain_diameter: float | None) -> list[mpm.Orifice]:
    """Return the small holes of the head of a scene's tool, for grains of a diameter [m]; None: no law for them."""
    shape = tool_shape(scene.tool)
    if scene.tool_wall != "shell":
        check_holes(shape, f"tool_wall of {scene.tool_wall} m")
    if shape.holes is not None and grain_diameter is None:
        raise ConfigError(f"tool {shape.name!r} with a material without grain_diameter, by which its holes let grains "
                          f"pass, or with cohesion, by which grains arch over them; accepted: salt, sugar, sand, "
                          f"glass_beads, or a file of one's own with that key and cohesion 0")
    return [] if grain_diameter is None else shape.orifices(grain_diameter)


def requested_step(scene: SceneConfig, law: Law) -> float | None:
    """Return the scene's own substep [s]; None where the law is too stiff for it and the solver chooses."""
    dt = scene.field.dt
    return None if dt is None or dt > accepted_bound(scene.field.cell, law, grain_volume(scene)) else dt


def fitted_step(duration: float, dt: float) -> float:
    """Return the longest substep [s] that divides a duration [s], at most `FITTED` times the default one dt [s]."""
    return duration / math.ceil(duration / (FITTED * dt))


def choose_substep(scene: SceneConfig, law: Law, volume: float | None = None) -> float:
    """Return the substep [s] of a scene's field with a law: the scene's own, or the default one as it fits an advance.
    volume: of a grain [m^3]; None: as the scene has it."""
    own = requested_step(scene, law) if scene.COMES_TO_REST else scene.field.dt
    return own or fitted_step(scene.advance_dt, choose_step(None, scene.field.cell, [law],
                                                            volume or grain_volume(scene)))


def choose_region(config: RehearsalConfig) -> RehearsalConfig:
    """Return a configuration with a region of the grains: around places and motion where the file gives none."""
    if config.field.region_lower is not None:
        return config
    points = [config.tool_pose(waypoint).position for waypoint in config.waypoints]
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
        points += list(container.pose.apply(corners))
    for place in filter(None, (config.pile, config.area)):
        points += [np.array(place.centre) - place.half, np.array(place.centre) + place.half]
    low, high = np.min(points, axis=0) - REGION_MARGIN, np.max(points, axis=0) + REGION_MARGIN
    region = {"region_lower": (float(low[0]), float(low[1]), 0.0), "region_upper": tuple(map(float, high))}
    field = FieldConfig.model_validate(config.field.model_dump() | region)
    return config.model_copy(update={"field": field})


def build_tool_sdf(tool: str | ToolConfig, thickness: float) -> Lattice:
    """Build the signed distance of a tool with a wall of a thickness [m]; raises ConfigError for one with holes."""
    check_holes(tool_shape(tool), f"wall of {thickness} m")
    return tool_shape(tool).distance(thickness, TOOL_SPACING)


def filled_volume(config: RehearsalConfig) -> float:
    """Return the volume [m^3] of the grains in a tool that is filled at the start, as they are placed."""
    positions, volume = fill(config, build_tool_lattice(config), mpm.Pose.identity())
    return volume * len(positions)


def check_holes(shape: ToolShape, wall: str) -> None:
    """Raise ConfigError for a tool with holes that is a solid in the field; wall: how its wall was given."""
    if shape.holes is not None:
        raise ConfigError(f"tool {shape.name!r} with a {wall}: its holes are smaller than a cell, and a solid has "
                          f"none; accepted: a task with tool_wall: shell, or another tool")


def build_container_colliders(scene: SceneConfig, *, static: bool = True) -> list[mpm.Collider]:
    """Build colliders of containers; static: they never move, which makes contact cheaper. Shells are never static."""
    colliders = []
    for name, container in scene.containers.items():
        is_shell, shape = name in scene.shells, container_shape(name, container)
        walls = shape.shell() if is_shell else shape.distance(CONTAINER_WALL * scene.field.cell, CONTAINER_SPACING)
        colliders.append(mpm.Collider(walls, static=static and not is_shell, friction=scene.field.container_friction,
                                      pose=container.pose))
    return colliders


def check_field(config: RehearsalConfig, law: Law) -> None:
    """Refuse numbers that the field cannot work with, before any work.
    Raises mpm.TimeStepTooLarge for field.dt, ConfigError for fill heights that exceed container or tool, for too
    many grains or substeps, and for a region that does not hold the containers or the pile."""
    if config.field.dt is not None:
        check_step(config.field.dt, config.field.cell, [law], "field.dt", grain_volume(config))
    longest = accepted_bound(config.field.cell, law, grain_volume(config))
    check_substeps("host_dt", config.host_dt, config.field.dt or longest)
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
    if config.sources:  # as the boxes around the insides of containers, up to their fill heights
        where, volume = f"container {' and '.join(map(repr, config.sources))}", 0.0
        for name in config.sources:
            low, high = container_shape(name, config.containers[name]).bounds
            volume += float(np.prod((high - low)[:2])) * config.containers[name].fill_height
    elif config.pile is not None:
        where, volume = "pile", 8.0 * float(np.prod(config.pile.half))
    else:  # as `sample_in_tool` does, with as much height again
        where, volume = config.tool_name, 12.0 * float(np.prod(tool_shape(config.tool).interior.half))
    count = volume * config.field.grains_per_cell / config.field.cell**3
    if count > MAX_GRAINS:
        raise ConfigError(f"field.grains_per_cell = {config.field.grains_per_cell} with field.cell = "
                          f"{config.field.cell} m: {count:.3g} grains in the {where}; accepted: up to {MAX_GRAINS}")


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
    held = {}
    for name, container in config.containers.items():
        low, high = container_shape(name, container).bounds
        corners = np.array([[x, y, low[2]] for x in (low[0], high[0]) for y in (low[1], high[1])])
        held[f"container {name!r}"] = container.pose.apply(corners)
    if config.pile is not None:
        held["the pile"] = np.array(config.pile.centre) + np.array(config.pile.half) * [[-1, -1, -1], [1, 1, 1]]
    for what, points in held.items():
        try:
            config.field.grid.check_inside(points)
        except mpm.InvalidValue as error:
            raise ConfigError(f"field.region_lower, region_upper do not hold {what}: {error}") from None
