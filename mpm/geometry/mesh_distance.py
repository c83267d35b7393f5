"""Signed distance of a closed mesh on a lattice: exact near the surface, signs by ray parity."""

import numpy as np
import trimesh
from scipy.ndimage import binary_dilation, distance_transform_edt
from scipy.spatial import cKDTree

BAND = 4.0  # half width, in lattice spacings, of the band in which distances are exact
NEIGHBOURS = 8  # surface samples per lattice point whose triangles are measured
MAX_SAMPLES = 400_000
RAY_OFFSET = np.array([1.234567e-5, 7.654321e-6])
"""Shift of the rays, in spacings, off the symmetry planes and edges that meshes love."""


def signed_distances(mesh: trimesh.Trimesh, lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return distances [m] at lower + spacing * (i, j, k), negative inside.
    Within BAND spacings of the surface the distance is that to the closest triangle; farther out it is carried over
    from the closest point of the band, good to a spacing."""
    samples, faces = _samples(mesh, spacing)
    touched = np.zeros(shape, bool)
    cells = np.round((samples - lower) / spacing).astype(int)
    inside_lattice = np.all((cells >= 0) & (cells < shape), axis=1)
    touched[tuple(cells[inside_lattice].T)] = True
    steps, nearest = distance_transform_edt(~touched, return_indices=True)
    band = np.argwhere(steps < BAND)
    exact = np.zeros(shape)
    points = band * spacing + lower
    _, candidates = cKDTree(samples).query(points, k=NEIGHBOURS)
    exact[tuple(band.T)] = _closest(mesh, points, faces[candidates], spacing)[0] * spacing
    far = steps >= BAND
    exact[far] = steps[far] * spacing + exact[tuple(axis[far] for axis in nearest)]
    return np.where(find_inside(mesh, lower, spacing, shape), -exact, exact)


def _samples(mesh: trimesh.Trimesh, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return points (n, 3) on a surface, and their faces (n,)."""
    count = int(min(6 * mesh.area / spacing**2 + 1000, MAX_SAMPLES))
    samples, faces = trimesh.sample.sample_surface(mesh, count, seed=0)[:2]
    # small triangles may get no sample of their own
    return np.concatenate([samples, mesh.triangles_center]), np.concatenate([faces, np.arange(len(mesh.faces))])


def _closest(mesh: trimesh.Trimesh, points: np.ndarray, candidates: np.ndarray,
             spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return distances (n,) to the closest of candidate faces (n, k), the closest points (n, 3) and their faces (n,).
    In units of the spacing: trimesh 5 compares with absolute tolerances, which millimetre triangles fall under."""
    triangles, scaled, best = mesh.triangles / spacing, points / spacing, np.full(len(points), np.inf)
    foot, face = np.zeros_like(points), np.zeros(len(points), int)
    for column in candidates.T:
        closest = trimesh.triangles.closest_point(triangles[column], scaled)
        distance = np.linalg.norm(closest - scaled, axis=1)
        nearer = distance < best
        best[nearer], foot[nearer], face[nearer] = distance[nearer], closest[nearer], column[nearer]
    return best, foot, face


def find_inside(mesh: trimesh.Trimesh, lower: np.ndarray, spacing: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return whether lattice points (shape) are inside: an odd number of crossings below them along z."""
    crossings = np.zeros((shape[0], shape[1], shape[2] + 1), np.int64)
    corner = np.asarray(lower)[:2] + RAY_OFFSET * spacing
    for triangle in mesh.triangles:
        low = np.maximum(np.ceil((triangle[:, :2].min(0) - corner) / spacing), 0).astype(int)
        high = np.minimum(np.floor((triangle[:, :2].max(0) - corner) / spacing), np.array(shape[:2]) - 1).astype(int)
        if np.any(high < low):
            continue
        i, j = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1), indexing="ij")
        rays = np.stack([i, j], -1) * spacing + corner
        (a, b, c) = triangle
        area = _cross(b[:2] - a[:2], c[:2] - a[:2])
        if area == 0:
            continue
        u = _cross(rays - a[:2], c[:2] - a[:2]) / area
        v = _cross(b[:2] - a[:2], rays - a[:2]) / area
        hit = (u >= 0) & (v >= 0) & (u + v <= 1)
        height = a[2] + u * (b[2] - a[2]) + v * (c[2] - a[2])
        first_above = np.clip(np.ceil((height - lower[2]) / spacing), 0, shape[2]).astype(int)
        np.add.at(crossings, (i[hit], j[hit], first_above[hit]), 1)
    return np.cumsum(crossings, axis=2)[:, :, : shape[2]] % 2 == 1


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def sheet_distances(mesh: trimesh.Trimesh, lower: np.ndarray, spacing: float, shape: tuple[int, ...],
                    band: float) -> tuple[np.ndarray, np.ndarray]:
    """Return signed distances [m] to an open surface at lower + spacing * (i, j, k), and where they have a side.

    Positive on the side that the faces' normals point to; outside the band, where nothing has a side, the value of the
    closest point in it. A point whose closest point lies on the rim has no side, beyond one step from it.

    Within BAND spacings the distance is that to the closest triangle, farther out that to the closest of samples half a
    spacing apart, good to a fiftieth of a spacing. The sign comes from normals interpolated between vertices, so that
    it holds over edges."""
    samples, faces, on_rim = _sheet_samples(mesh, spacing)
    points = np.stack(np.meshgrid(*(np.arange(n) for n in shape), indexing="ij"), -1).reshape(-1, 3) * spacing + lower
    tree = cKDTree(samples)
    reach, closest = tree.query(points, distance_upper_bound=band + 2 * spacing)
    values, sided = np.zeros(len(points)), np.zeros(len(points), bool)
    known, near = reach < np.inf, reach < BAND * spacing
    foot, face = samples[closest[known]], faces[closest[known]]
    values[known] = _side(mesh, points[known], foot, face) * reach[known]
    sided[known] = ~on_rim[closest[known]]
    _, candidates = tree.query(points[near], k=NEIGHBOURS)
    values[near], sided[near] = _signed_closest(mesh, points[near], faces[candidates], spacing)
    # one step past the rim, so that the nearest lattice point never ends the sheet short of it
    past = binary_dilation(sided.reshape(shape), np.ones((3, 3, 3))) & known.reshape(shape)
    nearest = distance_transform_edt(~known.reshape(shape), return_distances=False, return_indices=True)
    return values.reshape(shape)[tuple(nearest)], past


def _sheet_samples(mesh: trimesh.Trimesh, spacing: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (n, 3) on a surface and along its rim, their faces (n,), and whether they lie on the rim (n,)."""
    samples, faces = _samples(mesh, spacing)
    parts, owners = [samples], [faces]
    for edge in trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1):
        a, b = mesh.vertices[mesh.edges[edge]]
        u = np.linspace(0, 1, max(2, int(4 * np.linalg.norm(b - a) / spacing)))[:, None]
        parts.append(a + u * (b - a))
        owners.append(np.full(len(u), mesh.edges_face[edge]))
    samples = np.concatenate(parts)
    return samples, np.concatenate(owners), np.arange(len(samples)) >= len(faces)


def _side(mesh: trimesh.Trimesh, points: np.ndarray, foot: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Return +1 or -1 (n,): the side on which points lie of their closest points `foot` on faces."""
    size = np.sqrt(mesh.area_faces[face])[:, None, None]  # barycentric weights of millimetre triangles want units
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[face] / size, foot / size[:, 0])
    normals = np.einsum("nk,nkd->nd", weights, mesh.vertex_normals[mesh.faces[face]])
    return np.where(np.einsum("nd,nd->n", points - foot, normals) < 0, -1.0, 1.0)


def _signed_closest(mesh: trimesh.Trimesh, points: np.ndarray, candidates: np.ndarray,
                    spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the signed distances (n,) to the closest of candidate faces (n, k), and whether that is off the rim."""
    best, foot, face = _closest(mesh, points, candidates, spacing)
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[face] / spacing, foot)
    # edge i of a face joins corners i and i + 1; the foot is on it where the third weight vanishes
    rim = np.zeros((len(mesh.faces), 3), bool)
    rim.reshape(-1)[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)] = True
    on_rim = np.any(rim[face] & (weights[:, [2, 0, 1]] < 1e-6), axis=1)
    return _side(mesh, points, foot * spacing, face) * best * spacing, ~on_rim


def passage_width(mesh: trimesh.Trimesh) -> float:
    """Return the smallest gap [m] between parts of a surface that face each other; infinite without one."""
    return np.inf if mesh.is_convex else _gap_width(mesh, outwards=True)


def wall_thickness(mesh: trimesh.Trimesh) -> float:
    """Return the smallest thickness [m] of the solid in a closed surface."""
    return _gap_width(mesh, outwards=False, samples=100)


def _gap_width(mesh: trimesh.Trimesh, outwards: bool, samples: int = 400) -> float:
    """Return the smallest distance [m] to a part of the surface that faces another one, outwards or through the solid.
    Rays from the surface along its normals (for a sheet along both) until they meet it at an angle below 45 deg."""
    size = mesh.scale  # trimesh's tolerances are absolute: its rays pass millimetre triangles by
    mesh = trimesh.Trimesh(mesh.vertices * (1000.0 / size), mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(mesh, samples, seed=0)[:2]
    normals = mesh.face_normals[faces] * (1.0 if outwards else -1.0)
    if not mesh.is_watertight:
        points, normals = np.concatenate([points, points]), np.concatenate([normals, -normals])
    hits, rays, triangles = mesh.ray.intersects_location(points + 1e-2 * normals, normals, multiple_hits=False)
    facing = np.abs(np.einsum("nd,nd->n", mesh.face_normals[triangles], normals[rays])) > 0.7
    if not np.any(facing):
        return np.inf
    # a twentieth of the gaps may be shorter: a corner's few short rays are no passage
    widths = np.sort(np.linalg.norm(hits - points[rays], axis=1)[facing])
    return float(widths[len(widths) // 20]) * size / 1000.0
