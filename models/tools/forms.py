"""The handle that several tools share, and the files of a tool's meshes. Lengths are metres."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from curves import compute_end_scale, smoothstep, space_stations, sweep
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

WALL = 0.0015
"""Wall thickness of every tool."""
HANDLE_LENGTH, GRIP_START, GRIP_RADIUS = 0.200, 0.095, 0.011
"""Arc lengths of the handle and up to its full radius, and that radius."""
RISE, BEND = np.pi / 4, 0.060
"""Slope [rad] of the handle's straight part, and radius of the bend between tool and straight part."""


def make_handle(start: ArrayLike, segments: int = 28) -> trimesh.Trimesh:
    """Make the handle from a weld at `start` (3,) to its rounded end: a bend, then a straight part up and back."""
    end = 0.007
    s = space_stations(HANDLE_LENGTH, 0.001, end, inner=30, cap=4)
    angle, straight = np.minimum(s / BEND, RISE), np.maximum(s - BEND * RISE, 0.0)
    x = -BEND * np.sin(angle) - straight * np.cos(RISE)
    z = BEND * (1.0 - np.cos(angle)) + straight * np.sin(RISE)
    axis = np.stack([x, np.zeros_like(s), z], axis=1) + np.asarray(start)
    root = np.array([0.0065, 0.0035])  # flatter at the weld, so that it does not rise above the rim
    near = root + (np.array([0.0050, 0.0050]) - root) * smoothstep(s / 0.030)[:, None]
    half_axes = near + (GRIP_RADIUS - near) * smoothstep((s - 0.045) / (GRIP_START - 0.045))[:, None]
    scale = compute_end_scale(s, 0.0, end)[:, None]
    scale[s < 0.001] *= 0.9  # a small chamfer at the weld
    return sweep(axis, half_axes * scale, segments=segments)


def make_files(name: str, head: Callable[[float], trimesh.Trimesh], face: trimesh.Trimesh | None = None,
               handle_start: ArrayLike | None = None) -> dict[str, bytes]:
    """Make the files of a tool's meshes, by their names.

    head: wall thickness, grown outward -> closed head, whose vertices move in proportion to the wall. face: its inner
    face. STL is what MuJoCo reads; PLY keeps double precision, and the normals of the head's vertices are the way that
    they move for each metre of wall.
    """
    parts = {name: head(WALL)} | ({} if handle_start is None else {"handle": make_handle(handle_start)})
    files = {}
    for part, mesh in parts.items():
        if not (mesh.is_watertight and mesh.volume > 0.0):
            raise ValueError(f"{name}: {part} is not a closed solid")
        stl = mesh.export(file_type="stl")
        assert isinstance(stl, bytes)
        files[f"{part}.stl"], files[f"{part}.ply"] = stl, encode_ply(mesh)
    growth = head(2.0).vertices - head(1.0).vertices
    growth[np.abs(growth) < 1e-12] = 0.0
    files[f"{name}.ply"] = encode_ply(parts[name], growth)
    return files if face is None else files | {"inner_face.ply": encode_ply(face)}


def encode_ply(mesh: trimesh.Trimesh, normals: Array | None = None) -> bytes:
    """Return the content of a binary PLY file in double precision, which trimesh would write in single."""
    columns = mesh.vertices if normals is None else np.concatenate([mesh.vertices, normals], axis=1)
    names = ["x", "y", "z", "nx", "ny", "nz"][: columns.shape[1]]
    faces = np.zeros(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(columns)}",
              *(f"property double {name}" for name in names), f"element face {len(faces)}",
              "property list uchar int vertex_indices", "end_header\n"]
    return "\n".join(header).encode() + np.ascontiguousarray(columns, "<f8").tobytes() + faces.tobytes()


def write_files(files: dict[str, bytes], folder: Path) -> None:
    """Write files into a folder."""
    folder.mkdir(exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
