"""One frame of a recording as a .glb file: bodies, and grains as small icosahedra."""

import io
from pathlib import Path

import numpy as np
import trimesh
from trimesh.visual import ColorVisuals

from mpm.files import write
from robosim.base.errors import ConfigError
from robosim.recordings.reader import Recording
from robosim.rendering.body_shapes import export_glb

GRAIN_SHAPE = trimesh.creation.icosahedron()


def write_frame(recording: Recording, time: float, out: Path) -> float:
    """Write the frame nearest to a time [s] as a .glb file; return the frame's time [s].
    Raises ConfigError for a recording without frames, or with a damaged one."""
    n = len(recording)
    if not n:
        raise ConfigError(f"{recording.path}: has no frames")
    k = min(range(n), key=lambda i: abs(recording.scene(i).time - time))
    scene, moving = recording.scene(k), iter(recording.scene(k).poses)
    whole = trimesh.Scene()
    for body in recording.header.bodies:
        pose = next(moving) if body.moves else np.array([*body.position, *body.quaternion])
        if body.name not in recording.shapes:
            continue
        transform = trimesh.transformations.quaternion_matrix(pose[3:])
        transform[:3, 3] = pose[:3]
        try:
            part = trimesh.load_scene(io.BytesIO(recording.shapes[body.name]), file_type="glb")
        except Exception as error:  # as of any reader of meshes
            raise ConfigError(f"{recording.path}: damaged: shape of {body.name}: {error}; record the run again"
                              ) from None
        for name, geometry in part.geometry.items():
            whole.add_geometry(geometry, node_name=f"{body.name}/{name}", geom_name=f"{body.name}/{name}",
                               transform=transform)
    header = recording.header
    if header.grains:  # all in one mesh
        positions = recording.grains(k).positions
        shape, faces = np.array(GRAIN_SHAPE.vertices) * header.grain_radius, np.array(GRAIN_SHAPE.faces)
        offsets = len(shape) * np.arange(len(positions))
        mesh = trimesh.Trimesh((positions[:, None] + shape[None]).reshape(-1, 3),
                               (faces[None] + offsets[:, None, None]).reshape(-1, 3), process=False)
        colour = np.append(np.rint(255 * np.array(header.colour)), 255).astype(np.uint8)
        mesh.visual = ColorVisuals(mesh, vertex_colors=colour)
        whole.add_geometry(mesh, node_name="grains", geom_name="grains")
    content = export_glb(whole)
    write(out, lambda path: path.write_bytes(content))
    return scene.time
