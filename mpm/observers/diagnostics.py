"""Momentum, energy and diagnostics of a state, summed in double precision."""

import warnings
from typing import Any, NamedTuple

import numpy as np

from mpm.errors import GrainsLeaveGrid, SimulationDiverged
from mpm.materials.stress_update import LEAST_RATIO
from mpm.state.particles import AT_WALL


class Momentum(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) momentum, about the world's origin, with the affine part."""

    linear: np.ndarray
    angular: np.ndarray


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


def compute_momentum(solver: Any) -> Momentum:
    """Return the momentum of all particles of a solver."""
    m, x, v = solver.masses()[:, None], solver.positions(), solver.velocities()
    C = solver.particles.read(solver.particles.C).astype(float).reshape(-1, 3, 3)
    spin = np.stack([C[:, 2, 1] - C[:, 1, 2], C[:, 0, 2] - C[:, 2, 0], C[:, 1, 0] - C[:, 0, 1]], -1)
    angular = m * (np.cross(x, v) + solver.grid.cell**2 / 4.0 * spin)
    return Momentum((m * v).sum(0), angular.sum(0))


def compute_energy(solver: Any) -> Energy:
    """Return the energy of all particles of a solver; the elastic part is each law's, or of a fluid's volume."""
    m, x, v = solver.masses(), solver.positions(), solver.velocities()
    C = solver.particles.read(solver.particles.C).astype(float)
    kinetic = 0.5 * m @ ((v**2).sum(1) + solver.grid.cell**2 / 4.0 * (C**2).sum(1))
    volume = solver.particles.read([solver.particles.volume])[:, 0].astype(float)
    elastic = 0.0
    e = _strains(solver, C) if solver.particles.e else None
    for body, chosen in _ranges(solver):
        if body.material.state == "volume":
            j = solver.particles.read([solver.particles.j])[chosen, 0].astype(float)
            held = j if getattr(body.material, "tension", True) else np.minimum(j, 0.0)
            elastic += 0.5 * body.material.lam * volume[chosen] @ held**2
        elif e is not None:
            stretches = np.sqrt(np.maximum(1.0 + eigenvalues(e[:, chosen]), 1e-30)).T
            elastic += volume[chosen] @ body.material.energy_density(stretches)
    return Energy(float(kinetic), float(-(m[:, None] * x).sum(0) @ solver.gravity), float(elastic))


def eigenvalues(a: np.ndarray) -> np.ndarray:
    """Return the eigenvalues (3, n) of symmetric tensors, given as entries xx, yy, zz, xy, xz, yz (6, n).

    By the trigonometric formula (Smith 1961, Commun. ACM 4:168), in a tenth of the time of a solver of single matrices.
    """
    mean = (a[0] + a[1] + a[2]) / 3.0
    x, y, z, r, s, t = *(a[:3] - mean), *a[3:]
    scale = np.sqrt((x * x + y * y + z * z + 2.0 * (r * r + s * s + t * t)) / 6.0)
    det = x * (y * z - t * t) - r * (r * z - s * t) + s * (r * t - s * y)
    cube = np.maximum(scale, 1e-100) ** 3
    angle = np.arccos(np.clip(0.5 * det / cube, -1.0, 1.0)) / 3.0
    largest, least = mean + 2.0 * scale * np.cos(angle), mean + 2.0 * scale * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.stack([least, 3.0 * mean - largest - least, largest])


def compute_diagnostics(solver: Any) -> Diagnostics:
    """Return all diagnostics of a solver's state, whether it is finite or not."""
    x, v = solver.positions(), solver.velocities()
    finite = np.isfinite(x).all(1) & np.isfinite(v).all(1)
    bad = np.flatnonzero(~finite)
    with np.errstate(invalid="ignore", over="ignore"):
        speeds = np.linalg.norm(v, axis=1)
        fastest = float(np.max(speeds[finite], initial=0.0))
        energy = compute_energy(solver) if not len(bad) else Energy(np.nan, np.nan, np.nan)
        return Diagnostics(
            mass=float(solver.masses().sum()), momentum=compute_momentum(solver), energy=energy,
            cfl=fastest * solver.substep / solver.grid.cell, compaction=_compaction(solver),
            escaped=int(_find_on_walls(solver, x).any((1, 2)).sum()),
            first_non_finite=int(bad[0]) if len(bad) else None)


def _find_on_walls(solver: Any, x: np.ndarray) -> np.ndarray:
    """Return which particles at x [m] (n, 3) lie on the plane of which wall (n, axis, lower or upper)."""
    lower, tolerance = np.asarray(solver.grid.lower), AT_WALL * solver.grid.cell
    upper = lower + solver.grid.cells * solver.grid.cell
    is_wall = ~np.array(solver.features.periodic)[:, None]
    return np.stack([x <= lower + tolerance, x >= upper - tolerance], axis=-1) & is_wall


def warn_of_held(solver: Any, stacklevel: int) -> None:
    """Warn of particles that walls, other than floors, hold on their planes: they would have left."""
    x, gravity = solver.positions(), np.asarray(solver.gravity)
    on_walls = _find_on_walls(solver, x) & np.stack([gravity >= 0, gravity <= 0], axis=-1)
    held = np.flatnonzero(on_walls.any((1, 2)))
    sides = ", ".join("xyz"[axis] + "-+"[upper] for axis, upper in np.argwhere(on_walls.any(0)))
    warnings.warn(GrainsLeaveGrid(
        f"{len(held)} of {len(x)} particles would have left the grid by t = {solver.time:.4g} s and are held at walls "
        f"({sides}), first: particle {held[0]} at {tuple(x[held[0]].round(4).tolist())} m; make the grid larger, or "
        f"give a smaller dt if they were pressed through"), stacklevel=stacklevel)


def _ranges(solver: Any):  # noqa: ANN202
    """Yield each body and the slice of its particles."""
    first = 0
    for body, count in zip(solver.bodies, solver.particles.counts):
        yield body, slice(first, first + count)
        first += count


def _strains(solver: Any, C: np.ndarray) -> np.ndarray:
    """Return e = b - I of all particles, entries xx, yy, zz, xy, xz, yz (6, n), for C (n, 9).

    A substep begins by adding the strain of the last velocities C: with it the strain is that of the positions.
    """
    e = np.ascontiguousarray(solver.particles.read(solver.particles.e).T, float)
    a = np.ascontiguousarray((solver.substep * C).T)
    rows = [(e[0], e[3], e[4]), (e[3], e[1], e[5]), (e[4], e[5], e[2])]
    # (I + a) e + a, and that times (I + a)^T, and a^T
    p = [[rows[i][k] + a[3 * i] * rows[0][k] + a[3 * i + 1] * rows[1][k] + a[3 * i + 2] * rows[2][k] + a[3 * i + k]
          for k in range(3)] for i in range(3)]
    return np.stack([p[i][k] + p[i][0] * a[3 * k] + p[i][1] * a[3 * k + 1] + p[i][2] * a[3 * k + 2] + a[3 * k + i]
                     for i, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])


def _cauchy_green(solver: Any, C: np.ndarray) -> np.ndarray:
    """Return b (n, 3, 3) of all particles, the identity for fluids; see `_strains`."""
    if not solver.particles.e:
        return np.tile(np.eye(3), (len(C), 1, 1))
    return np.eye(3) + _strains(solver, C).T[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def volume_ratios(solver: Any, advanced: bool = True) -> np.ndarray:
    """Return J (n,) of all particles. advanced: with the strain of the last velocities, see `_cauchy_green`."""
    particles = solver.particles
    C = particles.read(particles.C).astype(float) * (1.0 if advanced else 0.0)
    ratios = np.sqrt(np.linalg.det(_cauchy_green(solver, C)))
    for body, chosen in _ranges(solver):
        if body.material.state == "volume":
            j = particles.read([particles.j])[chosen, 0].astype(float)
            growth = np.exp(np.arcsinh(solver.substep * C[chosen][:, [0, 4, 8]].sum(1)))  # as `advance_volume`
            ratios[chosen] = np.maximum((1.0 + j) * growth, LEAST_RATIO)
    return ratios


def _compaction(solver: Any) -> float:
    """Return the largest 1 - J."""
    loss = 0.0
    if solver.particles.e:
        e = solver.particles.read(solver.particles.e).astype(float)
        b = np.eye(3) + e[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
        loss = max(loss, float(1 - np.sqrt(np.maximum(np.nan_to_num(np.linalg.det(b), nan=1.0), 0).min())))
    if solver.particles.j is not None:
        loss = max(loss, float(-np.nan_to_num(solver.particles.read([solver.particles.j])).min()))
    return loss


def describe_divergence(solver: Any, dt: float) -> SimulationDiverged:
    """Return the error for a state that is not finite, or too fast for substeps of dt [s]."""
    speeds = np.linalg.norm(solver.velocities(), axis=1)
    worst = int(np.argmax(np.where(np.isfinite(speeds), speeds, np.inf)))
    lost = [index for index, row in zip(solver.mobility.indices, solver.mobility.table) if not np.isfinite(row).all()]
    error = SimulationDiverged(
        time=solver.time, step=solver.steps, particle=worst, position=tuple(solver.positions()[worst].tolist()),
        speed=float(speeds[worst]), cfl=float(speeds[worst] * dt / solver.grid.cell),
        collider=lost[0] if lost else None,
    )
    error.diagnostics = compute_diagnostics(solver)
    return error
