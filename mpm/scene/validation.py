"""What is suspicious about a scene, said before it runs: typed warnings with the value and the remedy."""

import warnings
from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from mpm.errors import InvalidValue, NarrowPassage, OverlappingBodies, StrongCompression
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid

CELLS_IN_A_PASSAGE = 4
"""Cells that grains need between two walls to flow."""
STRONG = 0.1
"""Strain at the base of a heap from which its height is visibly less than in reality."""


def finite(what: str, values: object, shape: tuple[int, ...]) -> np.ndarray:
    """A copy in double precision; raises InvalidValue for another shape, or numbers that are not finite."""
    array = np.array(values, float)
    if array.shape != shape or not np.isfinite(array).all():
        raise InvalidValue(f"{what} = {values}; accepted: finite numbers, shape {shape}")
    return array


def stored(state: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """One of a snapshot's arrays; raises InvalidValue where the snapshot is of another scene."""
    if name not in state:
        raise InvalidValue(f"load: the state has {', '.join(state)}; the scene also needs {name}")
    array = np.asarray(state[name])
    if array.shape != shape:
        raise InvalidValue(f"load: {name} has shape {array.shape}; the scene has {shape}")
    return array


def check_scene(grid: Grid, bodies: list[Body], colliders: list[Collider], gravity: np.ndarray) -> None:
    """Warn of bodies that overlap or that their own weight squeezes, and of passages that will jam."""
    for i, first in enumerate(bodies):
        for j in range(i + 1, len(bodies)):
            _check_overlap(i, first, j, bodies[j])
        _check_compression(i, first, gravity)
    for k, collider in enumerate(colliders):
        check_passage(grid, k, collider, stacklevel=5)


def check_passage(grid: Grid, k: int, collider: Collider, stacklevel: int = 4) -> None:
    """Warn of a collider k with a gap through which its grains cannot flow."""
    width = getattr(collider.sdf, "passage", np.inf)
    if width < CELLS_IN_A_PASSAGE * grid.cell:
        warnings.warn(NarrowPassage(
            f"collider {k} has a passage of {1e3 * width:.1f} mm, {width / grid.cell:.1f} cells: it will jam; give "
            f"cells of at most {1e3 * width / CELLS_IN_A_PASSAGE:.2g} mm"), stacklevel=stacklevel)


def _check_overlap(i: int, first: Body, j: int, second: Body) -> None:
    spacing = np.cbrt(min(np.min(np.asarray(first.volume)), np.min(np.asarray(second.volume))))
    distance, _ = cKDTree(first.positions).query(second.positions, distance_upper_bound=0.5 * spacing)
    inside = int(np.isfinite(distance).sum())
    if inside:
        warnings.warn(OverlappingBodies(
            f"{inside} of {len(second.positions)} grains of body {j} lie within half a grain of one of body {i}: they "
            f"would fly apart; move one of the bodies"), stacklevel=5)


def _check_compression(i: int, body: Body, gravity: np.ndarray) -> None:
    law, pull = body.material, np.linalg.norm(gravity)
    if pull > 0:
        height = np.ptp(np.asarray(body.positions) @ gravity / pull)
        strain = law.density * pull * height / (law.lam + 2 * law.mu)
        if strain > STRONG:
            stiffer = "bulk_modulus" if law.state == "volume" else "E"
            warnings.warn(StrongCompression(
                f"body {i} is {height:.3g} m high and so soft that its weight strains its base by {strain:.0%}; give "
                f"{strain / STRONG:.1f} times its {stiffer} or more"), stacklevel=5)
