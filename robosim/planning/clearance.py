"""Distances of a robot from its surroundings, and between its own parts: in a posture, along a path, and in a dose.
Collision shapes are those of the scene's model; meshes count as their convex hulls. Pinocchio places them, Coal finds
the distances. What hangs at the wrist may touch itself: the hand holds the tool."""

from importlib import import_module
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio

from mpm import Pose
from robosim.base.errors import ConfigError
from robosim.config.rehearsal import RehearsalConfig
from robosim.planning.lip_motion import make_lip_motion
from robosim.robot.inverse_kinematics import solve_pose, unreachable
from robosim.robot.mjspec import body_ids_below
from robosim.robot.model import Arm
from robosim.robot.timing import find_nearest
from robosim.scene.build import compile_rehearsal
from robosim.scene.compiled import Scene
from robosim.scene.container_clearance import ContainerSurface, monitor_containers

Geom = mujoco.mjtGeom
coal: Any = import_module("coal")  # a module in C++ without types

SHAPES = {
    Geom.mjGEOM_SPHERE: lambda a, b, c: coal.Sphere(a), Geom.mjGEOM_CAPSULE: lambda a, b, c: coal.Capsule(a, 2.0 * b),
    Geom.mjGEOM_CYLINDER: lambda a, b, c: coal.Cylinder(a, 2.0 * b), Geom.mjGEOM_ELLIPSOID: coal.Ellipsoid,
    Geom.mjGEOM_PLANE: lambda a, b, c: coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0),
    Geom.mjGEOM_BOX: lambda a, b, c: coal.Box(2.0 * a, 2.0 * b, 2.0 * c),
}
"""Kind of a geom -> Coal's shape of its size."""
CHECKED_SAMPLES = 4
"""Samples of the path from one measured posture to the next: at 0.04 s a tool at 0.3 m/s moves by 12 mm."""
TILT_STEP = np.radians(2.0)
"""Tilt [rad] from one checked pose of a dose to the next."""
LEAST = 5e-4
"""Smallest distance [m] of a planned motion from obstacles: a blade is led a millimetre above the table."""


class Nearest(NamedTuple):
    """The smallest distance of a posture; negative where two parts overlap."""

    distance: float
    """[m]"""
    parts: tuple[str, str]
    """Names of bodies."""


class PathClearance(NamedTuple):
    """The smallest distances in a posture, or along a path."""

    surroundings: Nearest
    """Of arm, hand and tool from table, floor, obstacles; of arm and hand from containers."""
    itself: Nearest
    """Between parts of the arm, and of hand and tool from the arm."""

    @property
    def least(self) -> Nearest:
        """The smaller of both."""
        return min(self, key=lambda nearest: nearest.distance)


FAR = Nearest(np.inf, ("", ""))
"""Where there is no pair."""


class RobotClearance:
    """Clearances of arm, hand and tool in a scene.
    The tool's distance from containers is that of `ContainerSurface`. standing: world pose of a tool that the hand does
    not hold, and keeps clear of; None: it holds it."""

    def __init__(self, scene: Scene, arm: Arm, standing: Pose | None = None) -> None:
        self._arm, self._geometry, self._scene, self._standing = arm, pinocchio.GeometryModel(), scene, standing
        model, data = scene.model, mujoco.MjData(scene.model)
        mujoco.mj_kinematics(model, data)
        own = set(scene.robot_bodies().tolist()) - ({scene.tool} if standing is not None else set())
        colliding = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
        self._bodies = [int(model.geom_bodyid[geom]) for geom in colliding]
        numbers = {geom: self._geometry.addGeometryObject(self._make_object(geom, data, body in own))
                   for geom, body in zip(colliding, self._bodies)}
        robot = [g for g in colliding if model.geom_bodyid[g] in own]
        if not [g for g in robot if model.body_weldid[model.geom_bodyid[g]] > 0]:
            raise ConfigError(f"robot {arm.assembly.robot.name}: its model has no geom with contype or conaffinity, so "
                              f"that collisions cannot be seen; accepted: a model with collision geometry")
        containers = {model.body(model.site_bodyid[k]).name for k in range(model.nsite)
                      if model.site(k).name.endswith("_inside")}
        carried = set(body_ids_below(model, scene.wrist).tolist())
        outer = [(a, b) for a in robot for b in colliding
                 if model.geom_bodyid[b] not in own and self._can_meet(a, b, containers)]
        inner = [(a, b) for k, a in enumerate(robot) for b in robot[k + 1 :]
                 if not {int(model.geom_bodyid[a]), int(model.geom_bodyid[b])} <= carried
                 and not self._are_neighbours(a, b)]
        for a, b in outer + inner:
            self._geometry.addCollisionPair(pinocchio.CollisionPair(numbers[a], numbers[b]))
        self._outer = len(outer)
        self._results = pinocchio.GeometryData(self._geometry)
        self._pairs = np.array([(pair.first, pair.second) for pair in self._geometry.collisionPairs]).reshape(-1, 2)
        shapes = self._geometry.geometryObjects
        self._spheres = [bounding_sphere(shape.geometry) for shape in shapes]
        """Of each shape, in its own frame."""
        self._moving = [k for k, shape in enumerate(shapes) if shape.parentJoint > 0]
        self._centres = np.array([shape.placement.act(centre) for shape, (centre, _) in zip(shapes, self._spheres)])
        self._radii = np.array([radius for _, radius in self._spheres])

    def measure(self, q: np.ndarray) -> PathClearance:
        """Return the smallest distances of a posture q (n,) [rad]."""
        arm = self._arm
        pinocchio.updateGeometryPlacements(arm.model, arm.data, self._geometry, self._results,
                                           arm.full_configuration(q))
        for k in self._moving:
            self._centres[k] = self._results.oMg[k].act(self._spheres[k][0])
        first, second = self._pairs.T
        apart = np.linalg.norm(self._centres[first] - self._centres[second], axis=1)
        apart -= self._radii[first] + self._radii[second]
        return PathClearance(self._find(apart[: self._outer], 0), self._find(apart[self._outer :], self._outer))

    def _find(self, apart: np.ndarray, begin: int) -> Nearest:
        """Return the nearest of pairs from number `begin` on, whose bounding spheres are `apart` (n,) [m].
        Pairs are measured from the smallest of these on, until no other can be nearer."""
        best, nearest = np.inf, FAR
        for k in np.argsort(apart):
            if apart[k] >= best:
                break
            pinocchio.computeDistance(self._geometry, self._results, begin + int(k))
            distance = float(self._results.distanceResults[begin + int(k)].min_distance)
            if distance < best:
                best, name = distance, self._scene.model.body
                nearest = Nearest(best, tuple(name(self._bodies[n]).name for n in self._pairs[begin + k]))
        return nearest

    def _make_object(self, geom: int, data: mujoco.MjData, is_own: bool) -> pinocchio.GeometryObject:
        """Make Pinocchio's object of a geom; what is no part of the robot stands still."""
        model = self._scene.model
        R, number = data.geom_xmat[geom].reshape(3, 3), model.geom_bodyid[geom]
        body = data.xmat[number].reshape(3, 3)
        local = pinocchio.SE3(body.T @ R, body.T @ (data.geom_xpos[geom] - data.xpos[number]))
        placement, joint = pinocchio.SE3(R, data.geom_xpos[geom]), 0
        if is_own:
            name = model.body(number).name
            frame = self._arm.model.frames[self._arm.model.getFrameId(name, pinocchio.FrameType.BODY)]
            placement, joint = frame.placement * local, frame.parentJoint
        elif self._standing is not None and number == self._scene.tool:
            placement = pinocchio.SE3(self._standing.matrix, self._standing.position) * local
        if model.geom_type[geom] == Geom.mjGEOM_MESH:
            mesh, points = model.geom_dataid[geom], coal.StdVec_Vec3s()
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            for point in model.mesh_vert[first : first + count].astype(float):
                points.append(point)
            shape = coal.Convex.convexHull(points, True, "Qt")
        else:
            shape = SHAPES.get(Geom(model.geom_type[geom]), SHAPES[Geom.mjGEOM_BOX])(*model.geom_size[geom])
        return pinocchio.GeometryObject(f"geom_{geom}", joint, joint, placement, shape)

    def _can_meet(self, own: int, other: int, containers: set[str]) -> bool:
        """Whether a geom of the robot and one of its surroundings can collide."""
        model, scene = self._scene.model, self._scene
        body = model.geom_bodyid[own]
        is_tool_at_container = body == scene.tool and model.body(model.geom_bodyid[other]).name in containers
        return model.body_weldid[body] > 0 and not is_tool_at_container and self._masks_meet(own, other)

    def _masks_meet(self, a: int, b: int) -> bool:
        model = self._scene.model
        kinds, affinities = model.geom_contype, model.geom_conaffinity
        return bool(kinds[a] & affinities[b] or kinds[b] & affinities[a])

    def _are_neighbours(self, a: int, b: int) -> bool:
        """Whether MuJoCo makes no contacts between two geoms: of one body, of a body and its parent, or excluded."""
        model, bodies = self._scene.model, sorted(int(self._scene.model.geom_bodyid[g]) for g in (a, b))
        first, second = (int(model.body_weldid[body]) for body in bodies)
        parents = [int(model.body_weldid[model.body_parentid[body]]) for body in (first, second)]
        are_linked = bool(first and second) and (first == parents[1] or second == parents[0])
        is_excluded = (bodies[0] << 16) + bodies[1] in model.exclude_signature
        return first == second or are_linked or is_excluded or not self._masks_meet(a, b)


class Clearances:
    """Distances in a rehearsal: of the robot from all else, and of the tool that it holds from containers.
    is_standing: whether a tool that is picked up still stands in its place."""

    def __init__(self, config: RehearsalConfig, arm: Arm, *, is_standing: bool = False) -> None:
        stand = config.standing_pose if is_standing else None
        self._config, self._arm = config, arm
        self._robot = RobotClearance(compile_rehearsal(config, arm.assembly), arm, stand)
        self._surface = monitor_containers(config) if stand is None else None

    def of_robot(self, q: np.ndarray) -> Nearest:
        """Return the smallest of a posture (n,) [rad] without that of the tool from containers."""
        return self._robot.measure(q).least

    def least(self, q: np.ndarray, reach: float) -> Nearest:
        """Return the smallest of a posture (n,) [rad], of the tool from containers below `reach` [m]."""
        nearest = self.of_robot(q)
        if self._surface is not None:
            distance = self._surface.measure(self._arm.tool_pose(q), reach)
            if distance < min(reach, nearest.distance):
                return Nearest(distance, (self._config.tool_name, "a container"))
        return nearest

    def check_path(self, passages: dict[str, float], times: np.ndarray, q: np.ndarray,
                   poses: list[Pose]) -> PathClearance:
        """Measure the clearances of postures q (n, joints) [rad], with the tool at poses, at times (n,) [s].
        passages: waypoint -> time [s]. Raises ConfigError for a collision: at which waypoint, of what with what, how
        deep."""
        least, surface = PathClearance(FAR, FAR), monitor_containers(self._config)
        for k in range(0, len(times), CHECKED_SAMPLES):
            found = self._robot.measure(q[k])
            least = PathClearance(*(min(pair, key=lambda nearest: nearest.distance) for pair in zip(least, found)))
            self._refuse(found, poses[k], surface, f"{find_nearest(passages, times[k])!r} (t = {times[k]:.2f} s)",
                         "move the waypoint, or what stands there")
        return least

    def check_dose(self, q: np.ndarray) -> None:
        """Check the whole range of tilt, with the lip where the dose begins and above the cup's middle.
        q: posture at the waypoint (n,) [rad]. Raises UnreachableWaypoint for a tilt that the arm cannot reach from
        there, ConfigError for one at which it would touch something: at which tilt, and what."""
        config, arm = self._config, self._arm
        if config.dose is None:
            return
        motion, surface = make_lip_motion(config), monitor_containers(config)
        largest = np.radians(config.dose.largest_tilt_deg)
        for lip in (motion.lip, motion.goal):
            posture = q
            for tilt in np.linspace(0.0, largest, int(np.ceil(largest / TILT_STEP)) + 1):
                pose, where = motion.pose(tilt, lip), f"{config.dose_at} (dose, tilt {np.degrees(tilt):.0f} deg)"
                solution = solve_pose(arm, pose, posture, rest=q)
                if not solution.converged:
                    raise unreachable(arm, where, pose, solution)
                posture = solution.q
                self._refuse(self._robot.measure(posture), pose, surface, where, "a smaller dose.largest_tilt_deg, "
                             "the lip above the cup's rim, or more room there")

    def _refuse(self, found: PathClearance, pose: Pose, surface: ContainerSurface | None, where: str,
                remedy: str) -> None:
        """Raise ConfigError for a posture whose clearances are below LEAST, or whose tool is in a container's wall."""
        collisions = [nearest for nearest in found if nearest.distance < LEAST]
        if not collisions and surface is not None:
            surface.record_penetrations(pose)
            if surface.penetrations:
                collisions = [Nearest(-surface.depth, (self._config.tool_name, "a container"))]
        for distance, (one, other) in collisions:
            what = f"overlap by {-1e3 * distance:.1f} mm" if distance < 0.0 else f"are {1e3 * distance:.1f} mm apart"
            raise ConfigError(f"near waypoint {where} {one} and {other} {what}; accepted: {1e3 * LEAST:g} mm or more; "
                              f"{remedy}")


def bounding_sphere(shape: Any) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius [m] of a sphere around a shape, in its frame; a plane has an infinite one."""
    if isinstance(shape, coal.Halfspace):
        return np.zeros(3), np.inf
    shape.computeLocalAABB()
    return np.array(shape.aabb_center), float(shape.aabb_radius)
