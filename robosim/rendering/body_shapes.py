"""Shapes of a MuJoCo model's bodies, as files of the glTF format that browsers and other tools read."""

from collections.abc import Iterator

import mujoco
import numpy as np
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

SHOWN_GROUPS = (0, 1, 2)
"""Groups of geoms that are drawn; higher ones hold collision shapes."""
SHARP_DEG = 35.0
"""Edges with a larger angle between their faces are drawn sharp [deg]."""
LEAST_FACES, LEFT_OUT = 600, 0.5
"""Meshes with more faces are drawn without this share: a browser without a GPU draws twice as fast."""
FLOOR_SIZE, FAR_FLOOR = 6.0, 200.0
"""Edge of the square that is drawn for an infinite plane [m], and where distances are measured."""
DEFAULT_COLOUR = (0.5, 0.5, 0.5, 1.0)
"""Of a geom without colour; then its material's holds."""


def can_move(model: mujoco.MjModel) -> np.ndarray:
    """Return which bodies (nbody,) can move: with a joint, on a mocap body, or on a body that can move."""
    moves = np.zeros(model.nbody, bool)
    for body in range(1, model.nbody):
        moves[body] = moves[model.body_parentid[body]] or model.body_dofnum[body] > 0 or model.body_mocapid[body] >= 0
    return moves


def body_shapes(model: mujoco.MjModel) -> dict[int, bytes]:
    """Return a .glb file for each body with visible geoms, in the body's frame [m]."""
    scenes: dict[int, trimesh.Scene] = {}
    for geom, body, mesh in shown_meshes(model):
        mesh.visual = TextureVisuals(material=_material(model, geom))
        scenes.setdefault(body, trimesh.Scene()).add_geometry(mesh)
    return {body: export_glb(scene) for body, scene in scenes.items()}


def shown_meshes(model: mujoco.MjModel, *, exact: bool = False) -> Iterator[tuple[int, int, trimesh.Trimesh]]:
    """Yield each visible geom, its body and its surface in the body's frame [m]; exact: as of `geom_mesh`."""
    for geom in range(model.ngeom):
        if model.geom_group[geom] in SHOWN_GROUPS and geom_colour(model, geom)[3] > 0.0:
            mesh = geom_mesh(model, geom, exact=exact)
            if mesh is not None:
                yield geom, int(model.geom_bodyid[geom]), mesh


def export_glb(scene: trimesh.Scene) -> bytes:
    """Return a scene as a .glb file."""
    content = scene.export(file_type="glb")
    assert isinstance(content, bytes)
    return content


def geom_colour(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the colour (4,) of a geom: its own, or its material's."""
    material, own = model.geom_matid[geom], model.geom_rgba[geom]
    return model.mat_rgba[material] if material >= 0 and np.allclose(own, DEFAULT_COLOUR) else own


def _material(model: mujoco.MjModel, geom: int) -> PBRMaterial:
    material, colour = model.geom_matid[geom], geom_colour(model, geom)
    shine = float(model.mat_shininess[material]) if material >= 0 else 0.3
    metal = float(model.mat_metallic[material]) if material >= 0 else 0.0
    return PBRMaterial(baseColorFactor=np.rint(255 * np.asarray(colour)).astype(np.uint8), doubleSided=colour[3] < 1.0,
                       roughnessFactor=min(max(1.0 - shine, 0.35), 1.0), metallicFactor=min(max(metal, 0.0), 0.3),
                       alphaMode="BLEND" if colour[3] < 1.0 else "OPAQUE")


def geom_mesh(model: mujoco.MjModel, geom: int, *, exact: bool = False) -> trimesh.Trimesh | None:
    """Return the surface of a geom in its body's frame [m]; None for kinds that have none.
    exact: with all its faces, instead of fewer that are shaded smoothly."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    mesh = _surface(model, geom, kind, size, FAR_FLOOR if exact else FLOOR_SIZE)
    if mesh is None:
        return None
    if not exact and len(mesh.faces) > LEAST_FACES and kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = mesh.simplify_quadric_decimation(percent=LEFT_OUT)
    if not exact and kind != mujoco.mjtGeom.mjGEOM_BOX:
        mesh = trimesh.graph.smooth_shade(mesh, np.radians(SHARP_DEG))
    transform = np.eye(4)
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    transform[:3, :3], transform[:3, 3] = rotation.reshape(3, 3), model.geom_pos[geom]
    mesh.apply_transform(transform)
    return mesh


def _surface(model: mujoco.MjModel, geom: int, kind: mujoco.mjtGeom, size: np.ndarray,
             floor: float) -> trimesh.Trimesh | None:
    """Return the surface of a geom in its own frame; floor: edge [m] of an infinite plane."""
    kinds = mujoco.mjtGeom
    if kind == kinds.mjGEOM_BOX:
        mesh = trimesh.creation.box(2.0 * size)
        return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(36).reshape(12, 3), process=False)
    if kind == kinds.mjGEOM_SPHERE:
        return trimesh.creation.icosphere(3, size[0])
    if kind == kinds.mjGEOM_ELLIPSOID:
        return trimesh.creation.icosphere(3, 1.0).apply_scale(size)
    if kind == kinds.mjGEOM_CYLINDER:
        return trimesh.creation.cylinder(size[0], 2.0 * size[1], sections=32)
    if kind == kinds.mjGEOM_CAPSULE:
        return trimesh.creation.capsule(2.0 * size[1], size[0], count=(16, 16))
    if kind == kinds.mjGEOM_PLANE:
        extent = np.where(size[:2] > 0.0, 2.0 * size[:2], floor)
        return trimesh.creation.box([*extent, 1e-4])
    if kind == kinds.mjGEOM_MESH:
        mesh = model.geom_dataid[geom]
        vertices = model.mesh_vert[model.mesh_vertadr[mesh] :][: model.mesh_vertnum[mesh]]
        return trimesh.Trimesh(vertices.astype(float), model.mesh_face[model.mesh_faceadr[mesh] :][
            : model.mesh_facenum[mesh]])
    if kind == kinds.mjGEOM_HFIELD:
        return _height_field(model, int(model.geom_dataid[geom]))
    return None


def _height_field(model: mujoco.MjModel, field: int) -> trimesh.Trimesh:
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    x, y, z, _ = model.hfield_size[field]
    heights = model.hfield_data[model.hfield_adr[field] :][: rows * columns]
    grid_y, grid_x = np.meshgrid(np.linspace(-y, y, rows), np.linspace(-x, x, columns), indexing="ij")
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, 1:].ravel(), corner[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return trimesh.Trimesh(np.stack([grid_x.ravel(), grid_y.ravel(), z * heights], 1), faces)
