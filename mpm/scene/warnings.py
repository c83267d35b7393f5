"""Warnings about scenes that cannot work well, raised at construction with the value and the remedy."""

import warnings

import numpy as np
from scipy.spatial import cKDTree

from mpm.errors import NarrowPassage, OverlappingBodies, StrongCompression
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid

CELLS_IN_A_PASSAGE = 4
"""Cells that particles need between two walls to flow."""
STRONG = 0.1
"""Strain at the base of a heap from which its height is visibly less than in reality."""


def warn_of_scene(grid: Grid, bodies: list[Body], colliders: list[Collider], gravity: np.ndarray) -> None:
    """Warn of bodies that overlap or that their own weight squeezes, and of passages that will jam."""
    for i, first in enumerate(bodies):
        for j in range(i + 1, len(bodies)):
            _warn_of_overlap(i, first, j, bodies[j])
        _warn_of_compression(i, first, gravity)
    for k, collider in enumerate(colliders):
        warn_of_passage(grid, k, collider, stacklevel=5)


def warn_of_passage(grid: Grid, k: int, collider: Collider, stacklevel: int = 4) -> None:
    """Warn of a collider k with a gap through which particles cannot flow."""
    width = getattr(collider.sdf, "passage", np.inf)
    if width < CELLS_IN_A_PASSAGE * grid.cell:
        warnings.warn(NarrowPassage(
            f"collider {k} has a passage of {1e3 * width:.1f} mm, {width / grid.cell:.1f} cells: it will jam; give "
            f"cells of at most {1e3 * width / CELLS_IN_A_PASSAGE:.2g} mm"), stacklevel=stacklevel)


def _warn_of_overlap(i: int, first: Body, j: int, second: Body) -> None:
    spacing = np.cbrt(min(np.min(np.asarray(first.volume)), np.min(np.asarray(second.volume))))
    distance, _ = cKDTree(first.positions).query(second.positions, distance_upper_bound=0.5 * spacing)
    inside = int(np.isfinite(distance).sum())
    if inside:
        warnings.warn(OverlappingBodies(
            f"{inside} of {len(second.positions)} grains of body {j} lie within half a grain of one of body {i}: they "
            f"would fly apart; move one of the bodies"), stacklevel=5)


def _warn_of_compression(i: int, body: Body, gravity: np.ndarray) -> None:
    law, pull = body.material, np.linalg.norm(gravity)
    if pull > 0:
        height = np.ptp(np.asarray(body.positions) @ gravity / pull)
        strain = law.density * pull * height / (law.lam + 2 * law.mu)
        if strain > STRONG:
            stiffer = "bulk_modulus" if law.state == "volume" else "E"
            warnings.warn(StrongCompression(
                f"body {i} is {height:.3g} m high and so soft that its weight strains its base by {strain:.0%}; give "
                f"{strain / STRONG:.1f} times its {stiffer} or more"), stacklevel=5)
