"""Colliders from the geoms of a MuJoCo body."""

from collections.abc import Callable

import mujoco
import numpy as np
import trimesh

import mpm
from mpm.geometry.shape import Shape
from robosim.base.errors import ConfigError
from robosim.robot.mjspec import body_pose

MESH_CELLS = 0.2
"""Lattice spacing of a mesh's signed distance, in cells of the grid."""


def make_collider(model: mujoco.MjModel, data: mujoco.MjData, body: int, cell: float,
                  excluded: frozenset[int] = frozenset()) -> mpm.Collider:
    """Make a collider in a body's frame, of its geoms and those of bodies fixed to it.
    Colliding geoms count, or all geoms if none collides: visual geoms are left out. excluded: bodies with colliders of
    their own. cell: the grid's spacing [m], to which meshes are sampled. Friction is the largest sliding friction of
    the geoms. A body fixed to the world becomes a static collider. Raises ConfigError for what makes no collider."""
    parts_of_body = [b for b in range(model.nbody) if b == body or _is_fixed_to(model, b, body, excluded - {body})]
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, parts_of_body))
    colliding = geoms[(model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0]
    chosen = colliding if len(colliding) else geoms
    if not len(chosen):
        raise ConfigError(f"body {model.body(body).name!r} has no geoms; give the index of a collider instead of None")
    T_bw = body_pose(data, body).inverse()
    parts: list[tuple[Shape, mpm.Pose]] = []
    for geom in chosen:
        T_wg = mpm.Pose.from_matrix(data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
        parts.append((_make_solid(model, int(geom), cell), T_bw @ T_wg))
    static = model.body_weldid[body] == 0 and model.body_mocapid[model.body_weldid[body]] < 0
    return mpm.Collider(mpm.Sdf.union(parts), friction=float(model.geom_friction[chosen, 0].max()),
                        pose=body_pose(data, body), static=bool(static))


def _is_fixed_to(model: mujoco.MjModel, body: int, ancestor: int, excluded: frozenset[int]) -> bool:
    """Whether a body is rigidly fixed to an ancestor. Bodies fixed to the world are not parts of one another."""
    separate = excluded | {0}
    while ancestor != 0 and body not in separate and model.body_jntnum[body] == 0 and model.body_mocapid[body] < 0:
        body = model.body_parentid[body]
        if body == ancestor:
            return True
    return False


def _make_solid(model: mujoco.MjModel, geom: int, cell: float) -> Shape:
    size, kinds = model.geom_size[geom], mujoco.mjtGeom
    kind = kinds(model.geom_type[geom])
    makers: dict[mujoco.mjtGeom, Callable[[], Shape]] = {
        kinds.mjGEOM_PLANE: mpm.Sdf.plane, kinds.mjGEOM_SPHERE: lambda: mpm.Sdf.sphere(size[0]),
        kinds.mjGEOM_CAPSULE: lambda: mpm.Sdf.capsule(size[0], size[1]),
        kinds.mjGEOM_ELLIPSOID: lambda: mpm.Sdf.ellipsoid(tuple(size)),
        kinds.mjGEOM_CYLINDER: lambda: mpm.Sdf.cylinder(size[0], size[1]),
        kinds.mjGEOM_BOX: lambda: mpm.Sdf.box(tuple(size)), kinds.mjGEOM_MESH: lambda: _make_mesh(model, geom, cell),
        kinds.mjGEOM_HFIELD: lambda: _make_height_field(model, int(model.geom_dataid[geom]))}
    if kind not in makers:
        raise ConfigError(f"geom {_describe(model, geom)} is of type {kind.name}; accepted: plane, sphere, capsule, "
                          f"ellipsoid, cylinder, box, mesh, height field")
    return makers[kind]()


def _describe(model: mujoco.MjModel, geom: int) -> str:
    body = model.body(int(model.geom_bodyid[geom])).name
    return f"{model.geom(geom).name or geom!r} of body {body!r}"


def _make_mesh(model: mujoco.MjModel, geom: int, cell: float) -> Shape:
    k = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[k], model.mesh_vertnum[k]
    face, faces = model.mesh_faceadr[k], model.mesh_facenum[k]
    mesh = trimesh.Trimesh(model.mesh_vert[first : first + count], model.mesh_face[face : face + faces], process=True)
    if not mesh.is_watertight:
        raise ConfigError(f"mesh {model.mesh(k).name!r} of geom {_describe(model, geom)} has open edges; accepted: a "
                          f"closed mesh, or a collider of your own: mpm.Shell.from_mesh(mesh, thickness)")
    return mpm.Sdf.from_mesh(mesh, spacing=MESH_CELLS * cell, margin=2 * MESH_CELLS * cell)


def _make_height_field(model: mujoco.MjModel, k: int) -> Shape:
    rows, columns, first = model.hfield_nrow[k], model.hfield_ncol[k], model.hfield_adr[k]
    half_x, half_y, top, _ = model.hfield_size[k]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    return mpm.Sdf.height_field(top * heights, (half_x, half_y))
