"""Colliders from the geoms of a MuJoCo body."""

import mujoco
import numpy as np
import trimesh

import mpm
from mpm.geometry.compound import Solid
from robosim.errors import ConfigError
from robosim.scene.frames import body_pose

MESH_CELLS = 0.2
"""Spacing of a mesh's distances, in cells of the grid."""


def collider_of(model: mujoco.MjModel, data: mujoco.MjData, body: int, cell: float,
                apart: frozenset[int] = frozenset()) -> mpm.Collider:
    """A collider in a body's frame, of its geoms and those of bodies fixed to it, less those `apart`.

    Geoms that MuJoCo lets collide count, or all if none does: those that only draw are left out. Friction is the
    largest sliding friction of the geoms. A body fixed to the world becomes a static collider. Raises ConfigError for a
    body without geoms, or with a mesh that is not closed.
    """
    carried = [b for b in range(model.nbody) if b == body or _fixed_to(model, b, body, apart - {body})]
    geoms = np.flatnonzero(np.isin(model.geom_bodyid, carried))
    colliding = geoms[(model.geom_contype[geoms] | model.geom_conaffinity[geoms]) != 0]
    chosen = colliding if len(colliding) else geoms
    if not len(chosen):
        raise ConfigError(f"body {model.body(body).name!r} has no geoms; give the index of a collider instead of None")
    T_bw = body_pose(data, body).inverse()
    parts: list[tuple[Solid, mpm.Pose]] = []
    for geom in chosen:
        T_wg = mpm.Pose.from_matrix(data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
        parts.append((_shape(model, int(geom), cell), T_bw @ T_wg))
    static = model.body_weldid[body] == 0 and model.body_mocapid[model.body_weldid[body]] < 0
    return mpm.Collider(mpm.Sdf.union(parts), friction=float(model.geom_friction[chosen, 0].max()),
                        pose=body_pose(data, body), static=bool(static))


def _fixed_to(model: mujoco.MjModel, body: int, ancestor: int, apart: frozenset[int]) -> bool:
    """Whether a body hangs rigidly on an ancestor. Bodies fixed to the world are not parts of one another."""
    while ancestor != 0 and body not in apart | {0} and model.body_jntnum[body] == 0 and model.body_mocapid[body] < 0:
        body = model.body_parentid[body]
        if body == ancestor:
            return True
    return False


def _shape(model: mujoco.MjModel, geom: int, cell: float) -> Solid:
    """The solid of one geom, in the geom's frame."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(model.geom_type[geom])
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return mpm.Sdf.plane()
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return mpm.Sdf.sphere(size[0])
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return mpm.Sdf.capsule(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return mpm.Sdf.ellipsoid(tuple(size))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return mpm.Sdf.cylinder(size[0], size[1])
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return mpm.Sdf.box(tuple(size))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, geom, cell)
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    raise ConfigError(f"geom {_name(model, geom)} is of type {kind.name}; accepted: plane, sphere, capsule, ellipsoid, "
                      f"cylinder, box, mesh, height field")


def _name(model: mujoco.MjModel, geom: int) -> str:
    body = model.body(int(model.geom_bodyid[geom])).name
    return f"{model.geom(geom).name or geom!r} of body {body!r}"


def _mesh(model: mujoco.MjModel, geom: int, cell: float) -> Solid:
    k = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[k], model.mesh_vertnum[k]
    face, faces = model.mesh_faceadr[k], model.mesh_facenum[k]
    mesh = trimesh.Trimesh(model.mesh_vert[first : first + count], model.mesh_face[face : face + faces], process=True)
    if not mesh.is_watertight:
        raise ConfigError(f"mesh {model.mesh(k).name!r} of geom {_name(model, geom)} has open edges, and a solid is "
                          f"closed; close it, or give a collider of your own: mpm.Shell.from_mesh(mesh, thickness)")
    return mpm.Sdf.from_mesh(mesh, spacing=MESH_CELLS * cell, margin=2 * MESH_CELLS * cell)


def _height_field(model: mujoco.MjModel, k: int) -> Solid:
    rows, columns, first = model.hfield_nrow[k], model.hfield_ncol[k], model.hfield_adr[k]
    half_x, half_y, top, _ = model.hfield_size[k]
    heights = model.hfield_data[first : first + rows * columns].reshape(rows, columns)
    return mpm.Sdf.height_field(top * heights, (half_x, half_y))
