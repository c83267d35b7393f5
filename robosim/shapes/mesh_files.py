"""Meshes of a laboratory's own tools and containers: read, checked, and made closed.
A closed part is a solid, an open one the middle of a wall. What is wrong with a file is refused by name, because a tool
that leaks or holds the wrong volume looks right in every picture."""

from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from mpm.files import show
from robosim.base.errors import ConfigError, DoubledFaces, note
from robosim.shapes.self_cuts import check_intersections

SUFFIXES = (".stl", ".obj", ".ply", ".glb")
MOST_BYTES = 200_000_000
MOST_FACES = 200_000
LARGEST, SMALLEST = 3.0, 5e-3
"""Longest edge [m] of the box around a tool or container, and the least; beyond them the unit is wrong."""
PASSES = 20
"""Most slivers in a row, side by side, that are mended."""
UNITS = {"millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254}
SIDE_SAMPLES = 40
"""Faces of an inner face by which its front side is found."""

Array = NDArray[np.float64]


def read_parts(path: Path, thickness: float | None = None, scale: float = 1.0) -> list[trimesh.Trimesh]:
    """Read the connected parts of a file as closed meshes [m], normals outward; they may overlap.
    thickness: of the walls [m] about open parts, half of it to each side. scale: of the file's unit. Raises ConfigError
    for an open part without a thickness or the reverse, and for a part or a wall that cuts itself."""
    parts = split_parts(read_mesh(path, scale))
    if thickness is not None and all(part.is_watertight for part in parts):
        raise ConfigError(f"{path}: closed, and thickness = {thickness} m is given; accepted: an open surface with a "
                          f"thickness, or a closed mesh without")
    solids = []
    for part in parts:
        what = ()
        if thickness is not None and not part.is_watertight:
            check_surface(part, path)
            part = thicken(part, thickness)
            what = (f"its wall of {1e3 * thickness:g} mm: thinner, or a surface without narrow places",)
        check_closed(part, path)
        check_intersections(part, path, *what)
        solids.append(part)
    alike = [np.append(solid.bounds, solid.moment_inertia / solid.volume) for solid in solids]
    if len(trimesh.grouping.unique_rows(alike, digits=6)[0]) < len(solids):
        raise ConfigError(f"{path}: {len(solids)} parts, of which some are the same solid; accepted: each part once")
    return solids


def read_surface(path: Path, scale: float = 1.0) -> trimesh.Trimesh:
    """Read the open parts of a file as one surface [m], or all of one that has none; raises ConfigError."""
    parts = split_parts(read_mesh(path, scale))
    surface = join([part for part in parts if not part.is_watertight] or parts)
    check_surface(surface, path)
    return surface


def turn_from_wall(face: trimesh.Trimesh, solids: list[trimesh.Trimesh], wall: float) -> None:
    """Turn the normals of an inner face away from the wall of closed meshes, `wall` [m] thick, that lies behind it."""
    some = np.linspace(0, len(face.faces) - 1, SIDE_SAMPLES).astype(int)
    ahead = face.triangles_center[some] + 0.5 * wall * face.face_normals[some]
    if np.mean(np.any([solid.contains(ahead) for solid in solids], axis=0)) > 0.5:
        face.invert()


def read_directions(path: Path, parts: list[trimesh.Trimesh]) -> Array:
    """Read the normals (n, 3) of a file's vertices, as they are; parts: what `read_parts` returns for the file.
    Raises ConfigError for a file of several parts, and for normals that let no vertex stay where it is."""
    mesh = trimesh.load(path, process=False)  # with `force` the normals would be computed
    if not isinstance(mesh, trimesh.Trimesh) or len(parts) > 1 or len(mesh.vertices) != len(parts[0].vertices):
        raise ConfigError(f"{path}: {len(parts)} parts, or several vertices at a place; accepted with thicken: "
                          f"normals: one part whose faces share their vertices, as a PLY file can have it")
    normals = np.array(mesh.vertex_normals)
    if np.all(np.linalg.norm(normals, axis=1) > 0.0):
        raise ConfigError(f"{path}: none of its vertex normals is zero, so that what it holds would shrink; accepted "
                          f"with thicken: normals: length 0 on the wall's inner side, as a PLY file can have it")
    return normals


def split_parts(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    """Return the parts of a mesh that are connected over edges."""
    labels = trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))
    return [pick_faces(mesh, labels == k) for k in range(int(labels.max()) + 1)]


def pick_faces(mesh: trimesh.Trimesh, chosen: NDArray[np.bool_]) -> trimesh.Trimesh:
    """Return some faces of a mesh with the vertices that they use."""
    part = trimesh.Trimesh(mesh.vertices, mesh.faces[chosen], process=False)
    part.remove_unreferenced_vertices()
    return part


def check_surface(surface: trimesh.Trimesh, path: Path) -> None:
    """Let all faces of a surface look to one side; raise ConfigError where none can, and for one that cuts itself."""
    mend_slivers(surface, path)
    if not surface.is_winding_consistent:
        raise ConfigError(f"{path}: has no front side, as a Moebius strip; accepted: a surface with two sides")
    check_intersections(surface, path)


def read_mesh(path: Path, scale: float = 1.0) -> trimesh.Trimesh:
    """Read a file with vertices merged, each face once (DoubledFaces), and its unit checked; raises ConfigError."""
    if not path.is_file():
        raise ConfigError(f"{show(path)}: no such file; accepted: a mesh, {' or '.join(SUFFIXES)}")
    if path.suffix.lower() not in SUFFIXES:
        raise ConfigError(f"{path}: {path.suffix or 'no'} format; accepted: {', '.join(SUFFIXES)}")
    if path.stat().st_size > MOST_BYTES:
        raise ConfigError(f"{path}: {path.stat().st_size:.3g} bytes; accepted: up to {MOST_BYTES:.3g}")
    try:
        scene = trimesh.load_scene(path, process=False)
        placed = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
        count = sum(max(len(part.faces), len(part.vertices) // 3) for part in placed if hasattr(part, "faces"))
        if count > MOST_FACES:  # before copies are made: a GLB file can place a mesh any number of times
            raise ValueError(f"{count} triangles; accepted: up to {MOST_FACES}")
        read = scene.to_mesh()
        mesh = trimesh.Trimesh(read.vertices, read.faces, process=False)  # without the file's normals and colours
    except Exception as error:  # a reader of many formats raises as many kinds
        raise ConfigError(f"{path}: cannot be read as a mesh: {error}") from None
    corners, faces = mesh.vertices, mesh.faces
    if not len(faces) or corners.shape[1] != 3 or not np.isfinite(corners).all() \
            or faces.min() < 0 or faces.max() >= len(corners):
        raise ConfigError(f"{path}: holds no triangles, or some without finite corners; accepted: a mesh of triangles")
    mesh.apply_scale(scale)
    size = float(mesh.extents.max())
    if not SMALLEST <= size <= LARGEST:
        likely = [f"{unit} (scale: {factor:g})" for unit, factor in UNITS.items() if 0.02 <= size * factor <= 1.0]
        raise ConfigError(f"{path}: {size:.4g} m long; accepted: {SMALLEST} to {LARGEST} m; is it in "
                          f"{' or '.join(likely) or 'another unit'}?")
    mesh.merge_vertices()
    mesh.update_faces(np.all(np.diff(np.sort(mesh.faces, axis=1), axis=1) > 0, axis=1))
    once = mesh.unique_faces()
    if not once.all():
        note(f"{path}: {int((~once).sum())} of {len(once)} faces join the same corners as another face; each is read "
             f"once", DoubledFaces)
        mesh.update_faces(once)
    mesh.remove_unreferenced_vertices()
    return mesh


def check_closed(mesh: trimesh.Trimesh, path: Path) -> None:
    """Raise ConfigError unless a mesh is closed; turn its normals outward."""
    mend_slivers(mesh, path)
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    bad = edges[counts != 2]
    if len(bad):
        x, y, z = 1e3 * mesh.vertices[bad[0, 0]]
        what = "open" if np.all(counts[counts != 2] == 1) else "open, or with more than two faces,"
        raise ConfigError(f"{path}: {what} at {len(bad)} edges, the first near ({x:.1f}, {y:.1f}, {z:.1f}) mm; "
                          f"accepted: a closed mesh, or a surface with a thickness")
    if np.linalg.matrix_rank(mesh.vertices - mesh.vertices[0], tol=1e-9) < 3:
        raise ConfigError(f"{path}: flat, its faces enclose no volume; accepted: a closed mesh, or a surface, each "
                          f"face once, with a thickness")
    if mesh.volume < 0.0:
        mesh.invert()


def mend_slivers(mesh: trimesh.Trimesh, path: Path) -> None:
    """Let neighbours look to one side, and give faces without area the other diagonal across their longest edge.
    Without them a closed mesh would be open; at a rim they are left out. Raises ConfigError for some that stay."""
    trimesh.repair.fix_winding(mesh)
    for _ in range(PASSES):
        faces, stays = mesh.faces.copy(), mesh.nondegenerate_faces()
        if stays.all():
            return
        longest = np.linalg.norm(np.roll(mesh.triangles, -1, axis=1) - mesh.triangles, axis=2).argmax(1)
        owner, changed = dict(zip(map(tuple, mesh.edges.tolist()), mesh.edges_face.tolist())), set()
        for face in np.flatnonzero(~stays).tolist():
            a, b, apex = np.roll(faces[face], -longest[face]).tolist()
            other = owner.get((b, a))
            if other is not None and not {face, other} & changed:
                opposite = int(faces[other].sum()) - a - b
                faces[face], faces[other] = (a, opposite, apex), (opposite, b, apex)
                changed |= {face, other}
            stays[face] = other is not None
        mesh.faces = faces[stays]
    raise ConfigError(f"{path}: {int((~mesh.nondegenerate_faces()).sum())} triangles without an area; accepted: a mesh "
                      f"whose triangles have one")


def thicken(mesh: trimesh.Trimesh, thickness: float) -> trimesh.Trimesh:
    """Make the wall about a surface, closed along its rim."""
    normals, count = mesh.vertex_normals, len(mesh.vertices)
    vertices = np.concatenate([mesh.vertices + 0.5 * thickness * normals, mesh.vertices - 0.5 * thickness * normals])
    a, b = mesh.edges[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)].T
    rim = np.concatenate([np.column_stack([b, a, a + count]), np.column_stack([b, a + count, b + count])])
    faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1] + count, rim])
    return trimesh.Trimesh(vertices, faces, process=False)


def join(parts: list[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return meshes as one, each with its own vertices."""
    shifts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return trimesh.Trimesh(np.concatenate([part.vertices for part in parts]),
                           np.concatenate([part.faces + shift for part, shift in zip(parts, shifts)]), process=False)


def subdivide(mesh: trimesh.Trimesh, edge: float) -> trimesh.Trimesh:
    """Return the same surface with edges of at most `edge` [m]."""
    found = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, edge, max_iter=16)
    return trimesh.Trimesh(found[0], found[1], process=False)
