"""Distances of a robot from its surroundings, and between its own parts, in any posture.

Collision shapes are those of the scene's model; meshes count as their convex hulls. Pinocchio places them, Coal finds
the distances. What hangs at the wrist may touch itself: the hand holds the tool.
"""

from importlib import import_module
from typing import Any, NamedTuple

import mujoco
import numpy as np
import pinocchio

from mpm import Pose
from robosim.base.errors import ConfigError
from robosim.robot.mjspec import body_ids_below
from robosim.robot.model import Arm
from robosim.scene.compiled import Scene

Geom = mujoco.mjtGeom
coal: Any = import_module("coal")  # a module in C++ without types


class Nearest(NamedTuple):
    """The smallest distance of a posture; negative where two parts overlap."""

    distance: float
    """[m]"""
    parts: tuple[str, str]
    """Names of bodies."""


def bounding_sphere(shape: Any) -> tuple[np.ndarray, float]:
    """Return centre (3,) and radius [m] of a sphere around a shape, in its frame; a plane has an infinite one."""
    if isinstance(shape, coal.Halfspace):
        return np.zeros(3), np.inf
    shape.computeLocalAABB()
    return np.array(shape.aabb_center), float(shape.aabb_radius)


FAR = Nearest(np.inf, ("", ""))
"""Where there is no pair."""


class RobotClearance:
    """Clearances of arm, hand and tool in a scene.

    The tool's distance from containers is that of `ContainerSurface`. standing: world pose of a tool that the hand does
    not hold, and keeps clear of; None: it holds it.
    """

    def __init__(self, scene: Scene, arm: Arm, standing: Pose | None = None) -> None:
        self._arm, self._geometry, self._scene = arm, pinocchio.GeometryModel(), scene
        model, data = scene.model, mujoco.MjData(scene.model)
        mujoco.mj_kinematics(model, data)
        own = set(scene.robot_bodies().tolist()) - ({scene.tool} if standing is not None else set())
        self._standing = standing
        colliding = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
        self._bodies, numbers = {}, {}
        for geom in colliding:
            body = int(model.geom_bodyid[geom])
            number = self._geometry.addGeometryObject(self._make_object(geom, data, body in own))
            numbers[geom], self._bodies[number] = number, body
        robot = [g for g in colliding if model.geom_bodyid[g] in own]
        if not [g for g in robot if model.body_weldid[model.geom_bodyid[g]] > 0]:
            raise ConfigError(f"robot {arm.assembly.robot.name}: its model has no geom with contype or conaffinity, so "
                              f"that collisions cannot be seen; accepted: a model with collision geometry")
        others = [g for g in colliding if model.geom_bodyid[g] not in own]
        for a in robot:
            for b in others:
                if self._can_meet(a, b):
                    self._geometry.addCollisionPair(pinocchio.CollisionPair(numbers[a], numbers[b]))
        self._outer = len(self._geometry.collisionPairs)
        carried = set(body_ids_below(model, scene.wrist).tolist())
        for k, a in enumerate(robot):
            for b in robot[k + 1 :]:
                pair = {int(model.geom_bodyid[a]), int(model.geom_bodyid[b])}
                if not pair <= carried and not self._are_neighbours(a, b):
                    self._geometry.addCollisionPair(pinocchio.CollisionPair(numbers[a], numbers[b]))
        self._results = pinocchio.GeometryData(self._geometry)
        self._pairs = np.array([(pair.first, pair.second) for pair in self._geometry.collisionPairs]).reshape(-1, 2)
        self._spheres = [bounding_sphere(shape.geometry) for shape in self._geometry.geometryObjects]
        """Of each shape, in its own frame."""
        self._moving = [k for k, shape in enumerate(self._geometry.geometryObjects) if shape.parentJoint > 0]
        self._centres = np.array([shape.placement.act(centre) for shape, (centre, _) in
                                  zip(self._geometry.geometryObjects, self._spheres)])
        self._radii = np.array([radius for _, radius in self._spheres])

    def measure(self, q: np.ndarray) -> tuple[Nearest, Nearest]:
        """Return the smallest distance from the surroundings, and that between parts of the robot.

        q: joint angles (n,) [rad].
        """
        arm = self._arm
        pinocchio.updateGeometryPlacements(arm.model, arm.data, self._geometry, self._results,
                                           arm.full_configuration(q))
        for k in self._moving:
            self._centres[k] = self._results.oMg[k].act(self._spheres[k][0])
        first, second = self._pairs.T
        apart = np.linalg.norm(self._centres[first] - self._centres[second], axis=1)
        apart -= self._radii[first] + self._radii[second]
        return self._find(apart[: self._outer], 0), self._find(apart[self._outer :], self._outer)

    def least(self, q: np.ndarray) -> Nearest:
        """Return the smaller of both."""
        return min(self.measure(q), key=lambda nearest: nearest.distance)

    def _find(self, apart: np.ndarray, begin: int) -> Nearest:
        """Return the nearest of pairs from number `begin` on, whose bounding spheres are `apart` (n,) [m].

        Pairs are measured from the smallest of these on, until no other can be nearer.
        """
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
        placement = pinocchio.SE3(R, data.geom_xpos[geom])
        joint = 0
        if is_own:
            name = model.body(number).name
            frame = self._arm.model.frames[self._arm.model.getFrameId(name, pinocchio.FrameType.BODY)]
            placement, joint = frame.placement * local, frame.parentJoint
        elif self._standing is not None and number == self._scene.tool:
            placement = pinocchio.SE3(self._standing.matrix, self._standing.position) * local
        return pinocchio.GeometryObject(f"geom_{geom}", joint, joint, placement, self._make_shape(geom))

    def _make_shape(self, geom: int) -> Any:
        """Make Coal's shape of a geom."""
        model = self._scene.model
        kind, (a, b, c) = model.geom_type[geom], model.geom_size[geom]
        if kind == Geom.mjGEOM_SPHERE:
            return coal.Sphere(a)
        if kind == Geom.mjGEOM_CAPSULE:
            return coal.Capsule(a, 2.0 * b)
        if kind == Geom.mjGEOM_CYLINDER:
            return coal.Cylinder(a, 2.0 * b)
        if kind == Geom.mjGEOM_ELLIPSOID:
            return coal.Ellipsoid(a, b, c)
        if kind == Geom.mjGEOM_PLANE:
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        if kind == Geom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = coal.StdVec_Vec3s()
            for point in model.mesh_vert[first : first + count].astype(float):
                points.append(point)
            return coal.Convex.convexHull(points, True, "Qt")
        return coal.Box(2.0 * a, 2.0 * b, 2.0 * c)

    def _can_meet(self, own: int, other: int) -> bool:
        """Whether a geom of the robot and one of its surroundings can collide."""
        model, scene = self._scene.model, self._scene
        body = model.geom_bodyid[own]
        is_tool_at_container = body == scene.tool and model.body(model.geom_bodyid[other]).name in self._containers()
        return model.body_weldid[body] > 0 and not is_tool_at_container and self._masks_meet(own, other)

    def _containers(self) -> set[str]:
        """Names of bodies with a site that marks their inside."""
        model = self._scene.model
        return {model.body(model.site_bodyid[k]).name for k in range(model.nsite)
                if model.site(k).name.endswith("_inside")}

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
