"""Warnings about scenes that cannot work well, raised at construction with the value and the remedy."""

import warnings

import numpy as np
from scipy.spatial import cKDTree

from mpm.errors import (
    CoarseGrains,
    GrainsInSolid,
    MpmWarning,
    NarrowPassage,
    OverlappingBodies,
    StrongCompression,
    ThinSolid,
    VolumeMismatch,
)
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.scene import Scene

CELLS_IN_A_PASSAGE = 4  # cells that particles need between two walls to flow
CELLS_IN_A_SOLID = 2
"""Cells of a static solid's thickness that keep the nodes on its two sides apart. Moving solids stop particles, too."""
STRONG = 0.1
"""Strain at the base of a heap from which its height is visibly less than in reality."""
DEEP = 0.25
"""Edges of a particle's cube by which its centre must lie inside a solid to count; a jittered filling of a vessel
reaches half of that."""
NEAR, FAR = 0.6, 1.6
"""Distances to the second neighbour that are accepted, in edges of a particle's cube: 1 in a lattice, 0.9 in a jittered
one, 0.74 at random, 1.1 in a close packing."""
LATTICE = 8  # fewest particles that have a spacing
PLACES, WINDOW = 4, 200
"""How many places of a body its spacing is measured at, and the particles around each."""


def warn_of_scene(scene: Scene) -> None:
    """Warn of bodies that overlap, are coarse or soft, and of colliders that jam, leak or hold particles in them."""
    for i, first in enumerate(scene.bodies):
        for j in range(i + 1, len(scene.bodies)):
            _warn_of_overlap(i, first, j, scene.bodies[j])
        _warn_of_compression(i, first, scene.gravity)
        _warn_of_spacing(i, first, scene.grid.cell)
    warn_of_colliders(scene, stacklevel=5)


def warn_of_colliders(scene: Scene, stacklevel: int = 4) -> None:
    """Warn of gaps through which particles cannot flow, walls through which they can, and particles in solids."""
    grid = scene.grid
    for k, collider in enumerate(scene.colliders):
        width = collider.sdf.passage
        if width < CELLS_IN_A_PASSAGE * grid.cell:
            _warn(NarrowPassage, f"collider {k} has a passage of {1e3 * width:.1f} mm, {width / grid.cell:.1f} cells: "
                  f"it will jam; give cells of at most {1e3 * width / CELLS_IN_A_PASSAGE:.2g} mm", stacklevel)
        if collider.sdf.is_thin:
            continue
        thickness = collider.sdf.least_thickness() if collider.static else np.inf
        if thickness < (CELLS_IN_A_SOLID - 1e-3) * grid.cell:
            _warn(ThinSolid, f"collider {k} is static and {1e3 * thickness:.2g} mm thin, {thickness / grid.cell:.1f} "
                  f"cells: particles on its two sides feel each other, and can pass; make it {CELLS_IN_A_SOLID} cells "
                  f"thick, give static = False, or make it an mpm.Shell", stacklevel)
        for i, body in enumerate(scene.bodies):
            _warn_of_grains_inside(i, body, k, collider, stacklevel)


def _warn(kind: type[MpmWarning], message: str, stacklevel: int = 5) -> None:
    """Warn at the line that called the solver's constructor or `set_colliders`."""
    warnings.warn(kind(message), stacklevel=stacklevel)


def _warn_of_grains_inside(i: int, body: Body, k: int, collider: Collider, stacklevel: int) -> None:
    """Warn of particles in a solid; a shape without a distance on the host is not checked."""
    positions, edges = np.asarray(body.positions, float), np.cbrt(np.asarray(body.volume, float))
    local = (positions - collider.pose.position) @ collider.pose.matrix
    near = collider.sdf.near_inside(local)
    if not len(near):
        return
    try:
        depth = -collider.sdf.distance(local[near])
    except NotImplementedError:
        return
    inside = int(np.sum(depth > DEEP * (edges[near] if edges.ndim else edges)))
    if inside:
        held = "they stay there for good" if collider.static else "they are pushed out"
        _warn(GrainsInSolid, f"{inside} of {len(positions)} grains of body {i} lie inside collider {k}, up to "
              f"{1e3 * depth.max():.2g} mm deep: {held}; move the body or the collider, or leave these grains out",
              stacklevel + 1)


def _warn_of_overlap(i: int, first: Body, j: int, second: Body) -> None:
    spacing = np.cbrt(min(np.min(np.asarray(first.volume)), np.min(np.asarray(second.volume))))
    distance, _ = cKDTree(first.positions).query(second.positions, distance_upper_bound=0.5 * spacing)
    inside = int(np.isfinite(distance).sum())
    if inside:
        _warn(OverlappingBodies, f"{inside} of {len(second.positions)} grains of body {j} lie within half a grain of "
              f"one of body {i}: they would fly apart; move one of the bodies")


def _warn_of_compression(i: int, body: Body, gravity: np.ndarray) -> None:
    law, pull = body.material, np.linalg.norm(gravity)
    if pull > 0:
        height = np.ptp(np.asarray(body.positions) @ gravity / pull)
        strain = law.density * pull * height / (law.lam + 2 * law.mu)
        if strain > STRONG:
            stiffer = "bulk_modulus" if law.state == "volume" else "E"
            _warn(StrongCompression, f"body {i} is {height:.3g} m high and so soft that its weight strains its base by "
                  f"{strain:.0%}; give {strain / STRONG:.1f} times its {stiffer} or more")


def _warn_of_spacing(i: int, body: Body, cell: float) -> None:
    """Warn of particles larger than a cell, and of volumes that do not fit the distances between particles."""
    positions = np.asarray(body.positions, float)
    edges = np.broadcast_to(np.cbrt(np.asarray(body.volume, float)), len(positions))
    if len(positions) < LATTICE:
        return
    if np.median(edges) > (1 + 1e-6) * cell:
        _warn(CoarseGrains, f"body {i} has grains of {1e3 * np.median(edges):.3g} mm, and the grid cells of "
              f"{1e3 * cell:.3g} mm: it falls apart into grains that do not touch; give cells of at least twice the "
              f"grains' spacing, or more and smaller grains")
    distances, places = _second_neighbours(positions)
    ratio = float(np.median(distances / edges[places]))
    if not NEAR <= ratio <= FAR:
        spacing = float(np.median(distances))
        _warn(VolumeMismatch, f"body {i} has grains of {np.median(edges) ** 3:.3g} m^3, which fit a spacing of "
              f"{1e3 * np.median(edges):.3g} mm, but they are {1e3 * spacing:.3g} mm apart; give about "
              f"volume = {spacing**3:.2g}, the spacing cubed")


def _second_neighbours(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return distances [m] to the second neighbours of some particles, and which particles these are.
    Measured in windows around a few of them, each with about `WINDOW` others, since a tree of all is slow."""
    extents = np.ptp(positions, axis=0)
    extents = extents[extents > 1e-3 * extents.max()] if extents.max() > 0 else np.ones(3)
    spacing = float((np.prod(extents) / len(positions)) ** (1.0 / len(extents)))
    columns = np.ascontiguousarray(positions.T)
    distances, places = [], []
    for centre in np.linspace(0, len(positions) - 1, 2 * PLACES + 1).astype(int)[1::2]:
        half = 0.5 * WINDOW ** (1.0 / 3.0) * spacing
        window = _cube(columns, centre, half)
        while len(window) < min(WINDOW // 4, len(positions)):
            half *= 2.0
            window = _cube(columns, centre, half)
        offset = np.abs(positions[window] - positions[centre]).max(1)
        inner = window if len(window) == len(positions) else window[offset < 0.6 * half]
        found, _ = cKDTree(positions[window]).query(positions[inner], k=3)
        distances.append(found[:, 2])
        places.append(inner)
    return np.concatenate(distances), np.concatenate(places)


def _cube(columns: np.ndarray, centre: int, half: float) -> np.ndarray:
    """Return which of the particles with coordinates (3, n) lie in a cube around one of them; half: its half edge."""
    chosen = np.flatnonzero(np.abs(columns[0] - columns[0, centre]) < half)
    for row in columns[1:]:
        chosen = chosen[np.abs(row[chosen] - row[centre]) < half]
    return chosen
