"""MuJoCo models of tools and containers of one's own: bodies, what is seen of them, and what collides."""

from functools import lru_cache

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from robosim.config.tool import HEAD
from robosim.shapes.containers import ContainerShape
from robosim.shapes.mesh_files import subdivide
from robosim.shapes.tool import ToolShape

SECTORS, BANDS = 24, 8
"""Convex parts of a container's wall, around its axis and from floor to rim: hulls of an 8 cm bowl's parts reach
2 mm into its inside, those of a box's rounded edges 4 mm."""
FLOOR_SLOPE = 0.7
"""Vertical part of a face's normal from which it belongs to a floor."""
GRIP_FRICTION = (1.0, 0.005, 0.0001)
GLASS = (0.80, 0.86, 0.90, 0.45)

Array = NDArray[np.float64]


def build_tool_spec(tool: ToolShape) -> mujoco.MjSpec:
    """Build a tool's body: mass and inertia of its mesh, a capsule along its handle, and its head's convex hull."""
    spec = mujoco.MjSpec()
    body = spec.worldbody.add_body(name=tool.name)
    body.mass, body.ipos, inertia = tool.inertia()
    body.explicitinertial = True
    body.fullinertia = [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    add_mesh(spec, f"{tool.name}_mesh", tool.mesh)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{tool.name}_mesh", group=2, contype=0, conaffinity=0,
                  mass=0.0, rgba=[*tool.config.colour, 1.0])
    rest = tool.head_vertices()
    if len(rest) > 3 and np.linalg.matrix_rank(rest - rest.mean(0), tol=1e-6) == 3:
        add_mesh(spec, f"{tool.name}_head", trimesh.convex.convex_hull(rest))
        body.add_geom(name=f"{tool.name}_head", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{tool.name}_head", group=3,
                      contype=HEAD, conaffinity=0, mass=0.0)
    body.add_geom(name=f"{tool.name}_handle", type=mujoco.mjtGeom.mjGEOM_CAPSULE, group=3, mass=0.0,
                  fromto=np.concatenate(tool.handle), size=[tool.radius, 0.0, 0.0], friction=GRIP_FRICTION)
    body.add_site(name=f"{tool.name}_grip", pos=tool.grip[:3, 3], group=4, size=[0.004, 0.004, 0.004],
                  quat=Rotation.from_matrix(tool.grip[:3, :3]).as_quat(scalar_first=True))
    return spec


def add_container_body(spec: mujoco.MjSpec, name: str, shape: ContainerShape) -> mujoco.MjsBody:
    """Add a container's static body: its walls, and convex parts of them that arm, hand and handles meet."""
    body, walls = spec.worldbody.add_body(name=name), shape.walls()
    add_mesh(spec, f"{name}_walls", walls)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{name}_walls", group=2, contype=0, conaffinity=0,
                  mass=0.0, rgba=GLASS)
    for number, part in enumerate(split_wall(shape)):
        part_name = f"{name}_part_{number}"
        add_mesh(spec, part_name, part)
        body.add_geom(name=part_name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=part_name, group=3, mass=0.0,
                      rgba=[0.3, 0.5, 0.8, 0.4])
    return body


def add_mesh(spec: mujoco.MjSpec, name: str, mesh: trimesh.Trimesh) -> None:
    """Add a mesh's vertices and faces to a specification."""
    spec.add_mesh(name=name, uservert=mesh.vertices.ravel(), userface=mesh.faces.ravel())


@lru_cache(maxsize=64)  # it takes longer than all else of a container's model
def split_wall(shape: ContainerShape) -> list[trimesh.Trimesh]:
    """Split a container's wall into the hulls of its sectors.
    Together they hold all of the wall; where a sector is curved its hull reaches beyond it."""
    lower, upper = shape.bounds
    centre = np.array([*(0.5 * (lower + upper))[:2], upper[2]])
    fine = subdivide(shape.walls(), 0.4 * float(np.linalg.norm(upper - lower)) / BANDS)
    offset = fine.triangles_center - centre
    around = np.arctan2(offset[:, 1], offset[:, 0])
    down = np.arctan2(np.hypot(offset[:, 0], offset[:, 1]), -offset[:, 2])
    sector = np.clip(((around + np.pi) / (2.0 * np.pi) * SECTORS).astype(int), 0, SECTORS - 1)
    band = np.clip((down / (0.5 * np.pi) * BANDS).astype(int), 0, BANDS - 1)
    sector[band == 0] = 0  # one disc in the middle of the floor
    is_floor = np.abs(fine.face_normals[:, 2]) > FLOOR_SLOPE  # a hull over the corner of floor and wall would fill it
    keys = 2 * (SECTORS * band + sector) + is_floor
    parts = []
    for key in np.unique(keys):
        points = np.unique(fine.vertices[fine.faces[keys == key]].reshape(-1, 3), axis=0)
        if len(points) > 3 and np.linalg.matrix_rank(points - points.mean(0), tol=1e-5) == 3:
            parts.append(trimesh.convex.convex_hull(points))
    return parts
