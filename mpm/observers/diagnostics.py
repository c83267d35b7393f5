"""Momentum, energy and diagnostics of a state, summed in double precision."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpm.errors import GrainsLeaveGrid, SimulationDiverged
from mpm.materials.density import share_at
from mpm.materials.material import stiffens_with_density
from mpm.observers.readings import Momentum, Readings
from mpm.state.particles import AT_WALL


class Energy(NamedTuple):
    """Kinetic (affine part included), potential (against z = 0) and elastic energy [J]."""

    kinetic: float
    potential: float
    elastic: float


class Diagnostics(NamedTuple):
    """Mass, momentum, energy and signs of an inaccurate run."""

    mass: float
    """Total mass [kg]."""
    momentum: Momentum
    """Linear [N s] and angular [N m s] momentum."""
    energy: Energy
    """Kinetic, potential and elastic energy [J]."""
    cfl: float
    """CFL number: cells that the fastest particle travels in a substep."""
    compaction: float
    """Largest elastic decrease of volume of a particle, 1 - J."""
    escaped: int
    """Number of particles on the plane of a wall, or closer than AT_WALL; an accurate run has none there for long."""
    first_non_finite: int | None
    """Index of the first particle with a value that is not finite; None: all are finite."""


def compute_momentum(r: Readings) -> Momentum:
    """Return the momentum of all particles."""
    m, x, v = r.masses()[:, None], r.positions(), r.velocities()
    C = r.particles.read(r.particles.C).astype(float).reshape(-1, 3, 3)
    spin = np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], -1)
    angular = m * (np.cross(x, v) + r.scene.grid.cell**2 / 4.0 * spin)
    return Momentum((m * v).sum(0), angular.sum(0))


def compute_energy(r: Readings) -> Energy:
    """Return the energy of all particles of a state; the elastic part is each law's, or of a fluid's volume."""
    m, x, v = r.masses(), r.positions(), r.velocities()
    C = r.particles.read(r.particles.C).astype(float)
    # sums by einsum: the threads of `@` wait for a core that others use, for longer than all the rest takes
    kinetic = 0.5 * (np.einsum("i,ij,ij->", m, v, v) + r.scene.grid.cell**2 / 4.0 * np.einsum("i,ij,ij->", m, C, C))
    volume = r.particles.read([r.particles.volume])[:, 0].astype(float)
    elastic = 0.0
    e = r.strains(C) if r.particles.e else None
    for body, chosen in r.ranges():
        if body.material.state == "volume":
            j = r.particles.read([r.particles.j])[chosen, 0].astype(float)
            held = j if getattr(body.material, "tension", True) else np.minimum(j, 0.0)
            elastic += 0.5 * body.material.lam * np.einsum("i,i,i->", volume[chosen], held, held)
        elif e is not None:
            stretches = np.sqrt(np.maximum(1.0 + eigenvalues(e[:, chosen]), 1e-30)).T
            density = body.material.energy_density(stretches)
            if stiffens_with_density(body.material):
                around = r.particles.read([r.particles.around])[chosen, 0].astype(float)
                density *= share_at(around / r.scene.grid.cell**3, body.material.density)
            elastic += np.einsum("i,i->", volume[chosen], density)
    return Energy(float(kinetic), float(-(m[:, None] * x).sum(0) @ r.scene.gravity), float(elastic))


def momentum_after_advance(r: Readings) -> Momentum:
    """Return the momentum after the last advance or load, summed in the kernel without a copy of the state."""
    if r.progress.momentum is None:
        r.progress.momentum = compute_momentum(r)
    return r.progress.momentum


def eigenvalues(a: np.ndarray) -> np.ndarray:
    """Return the eigenvalues (3, n) of symmetric tensors, given as entries xx, yy, zz, xy, xz, yz (6, n).
    By the trigonometric formula (Smith 1961, Commun. ACM 4:168), in a tenth of the time of a solver of single
    matrices."""
    mean = (a[0] + a[1] + a[2]) / 3.0
    x, y, z, r, s, t = *(a[:3] - mean), *a[3:]
    scale = np.sqrt((x * x + y * y + z * z + 2.0 * (r * r + s * s + t * t)) / 6.0)
    det = x * (y * z - t * t) - r * (r * z - s * t) + s * (r * t - s * y)
    cube = np.maximum(scale, 1e-100) ** 3
    angle = np.arccos(np.clip(0.5 * det / cube, -1.0, 1.0)) / 3.0
    largest, least = mean + 2.0 * scale * np.cos(angle), mean + 2.0 * scale * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.stack([least, 3.0 * mean - largest - least, largest])


def compute_diagnostics(r: Readings) -> Diagnostics:
    """Return all diagnostics of a state, whether it is finite or not."""
    x, v = r.positions(), r.velocities()
    finite = np.isfinite(x).all(1) & np.isfinite(v).all(1)
    bad = np.flatnonzero(~finite)
    with np.errstate(invalid="ignore", over="ignore"):
        speeds = np.linalg.norm(v, axis=1)
        fastest = float(np.max(speeds[finite], initial=0.0))
        energy = compute_energy(r) if not len(bad) else Energy(np.nan, np.nan, np.nan)
        return Diagnostics(mass=float(r.masses().sum()), momentum=compute_momentum(r), energy=energy,
                           cfl=fastest * r.progress.substep / r.scene.grid.cell, compaction=_compaction(r),
                           escaped=int(_find_on_walls(r, x).any((1, 2)).sum()),
                           first_non_finite=int(bad[0]) if len(bad) else None)


def _find_on_walls(r: Readings, x: np.ndarray) -> np.ndarray:
    """Return which particles at x [m] (n, 3) lie on the plane of which wall (n, axis, lower or upper)."""
    lower, tolerance = np.asarray(r.scene.grid.lower), AT_WALL * r.scene.grid.cell
    upper = lower + r.scene.grid.cells * r.scene.grid.cell
    is_wall = ~np.array(r.fields.features.periodic)[:, None]
    return np.stack([x <= lower + tolerance, x >= upper - tolerance], axis=-1) & is_wall


def warn_of_held(r: Readings, stacklevel: int) -> None:
    """Warn of particles that walls, other than floors, hold on their planes: they would have left."""
    x, gravity = r.positions(), np.asarray(r.scene.gravity)
    on_walls = _find_on_walls(r, x) & np.stack([gravity >= 0, gravity <= 0], axis=-1)
    held = np.flatnonzero(on_walls.any((1, 2)))
    sides = ", ".join("xyz"[axis] + "-+"[upper] for axis, upper in np.argwhere(on_walls.any(0)))
    warnings.warn(GrainsLeaveGrid(
        f"{len(held)} of {len(x)} particles would have left the grid by t = {r.progress.time:.4g} s and are held at "
        f"walls ({sides}), first: particle {held[0]} at {tuple(x[held[0]].round(4).tolist())} m; make the grid larger, "
        f"or give a smaller dt if they were pressed through"), stacklevel=stacklevel)


def _compaction(r: Readings) -> float:
    """Return the largest 1 - J."""
    loss = 0.0
    if r.particles.e:
        e = r.particles.read(r.particles.e).astype(float)
        b = np.eye(3) + e[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        loss = max(loss, float(1 - np.sqrt(np.maximum(np.nan_to_num(np.linalg.det(b), nan=1.0), 0).min())))
    if r.particles.j is not None:
        loss = max(loss, float(-np.nan_to_num(r.particles.read([r.particles.j])).min()))
    return loss


def describe_divergence(r: Readings, dt: float, lost: Sequence[int] = ()) -> SimulationDiverged:
    """Return the error for a state that is not finite, or too fast for substeps of dt [s].
    lost: mobile colliders whose motion is not finite."""
    speeds = np.linalg.norm(r.velocities(), axis=1)
    worst = int(np.argmax(np.where(np.isfinite(speeds), speeds, np.inf)))
    error = SimulationDiverged(time=r.progress.time, step=r.progress.steps, particle=worst,
                               position=tuple(r.positions()[worst].tolist()), speed=float(speeds[worst]),
                               cfl=float(speeds[worst] * dt / r.scene.grid.cell), collider=lost[0] if lost else None)
    error.diagnostics = compute_diagnostics(r)
    return error
