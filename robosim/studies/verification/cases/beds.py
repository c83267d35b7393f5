"""Steps, stresses, columns and motions that cases have in common."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import mpm
from mpm.materials.material import Material
from mpm.scene.sampling import JITTER
from robosim.studies.verification.cases.case import TimedSolver

UPRIGHT = mpm.Pose.identity().quaternion
SLICE = mpm.Walls(lower=("slip", "periodic", "friction"), upper=("slip", "periodic", "slip"))
"""Walls of a slice in plane strain on a rough floor."""
SMOOTH_SLICE = mpm.Walls(lower=("slip", "periodic", "slip"), upper=("slip", "periodic", "slip"))
INCLINE = mpm.Walls(lower=("periodic", "periodic", "stick"), upper=("periodic", "periodic", "slip"))
"""Walls of a sheet on a rough plane."""


def rim(radius: float, a: float) -> float:
    """Return the radius [m] of the deposit of a column of sand, a radii high.
    Source: fit of Lube et al. 2004, J. Fluid Mech. 508:175."""
    return radius * (1 + (1.24 * a if a < 1.7 else 1.6 * math.sqrt(a)))


def fill_column(radius: float, height: float, cell: float, rng: np.random.Generator, *,
                per_cell: int = 4) -> np.ndarray:
    """Return positions [m] (n, 3) of a quarter of a column about its foot, jittered sites of a lattice of half cells.
    per_cell: 8 for all sites, 4 for the face-centred half, 2 for the body-centred quarter; the number of particles does
    not depend on the jitter."""
    half = cell / 2
    n, layers = math.ceil(radius / half), max(round(height / half), 2)
    sites = np.stack(np.meshgrid(*[np.arange(n)] * 2, np.arange(layers), indexing="ij"), -1)
    sites = sites.reshape(-1, 3)
    if per_cell == 4:
        sites = sites[sites.sum(1) % 2 == 0]
    elif per_cell == 2:
        sites = sites[np.all(sites % 2 == sites[:, :1] % 2, axis=1)]
    grains = (sites + 0.5) * (half, half, height / layers)
    grains = grains[np.hypot(grains[:, 0], grains[:, 1]) <= radius]
    return grains + rng.uniform(-JITTER, JITTER, grains.shape) * half


def courant_step(courant: float, cell: float, law: Material) -> float:
    """Return the substep [s] of a Courant number, in cells over the speed of pressure waves."""
    return courant * cell / math.sqrt((law.lam + 2 * law.mu) / law.density)


def shear_ratio(phi_deg: float, cone: str = "compression") -> float:
    """Return m3, shear stress over pressure in steady simple shear [-], of sand with a friction angle [deg].
    From the cone's definition, not from the law under test."""
    sine = math.sin(math.radians(phi_deg))
    return sine if cone == "plane_strain" else 2.0 * math.sqrt(3.0) * sine / (3.0 - sine)


def plane_strain_angle(shear_deg: float) -> float:
    """Return the friction angle [deg] with which the cone of plane strain carries the tangent of an angle [deg] in
    simple shear, see `shear_ratio`."""
    return math.degrees(math.asin(math.tan(math.radians(shear_deg))))


@dataclass(frozen=True, kw_only=True)
class Beads:
    """Grains of the law mu(I) in plane strain."""

    packing: float
    """Share of solid [-]."""
    slow_deg: float
    """Angle [deg] whose tangent they carry in slow simple shear; `fast_deg` in fast."""
    fast_deg: float
    inertial_number: float

    def make_law(self, E: float, nu: float, reference: dict[str, Any]) -> mpm.MuIRheology:
        """Return the law of beads of a reference's `grain_diameter` [m] and `grain_density` [kg/m^3]; E [Pa]."""
        return mpm.MuIRheology(
            E=E, nu=nu, density=self.packing * reference["grain_density"], cone="plane_strain",
            friction_angle_deg=plane_strain_angle(self.slow_deg), limit_angle_deg=plane_strain_angle(self.fast_deg),
            grain_diameter=reference["grain_diameter"], grain_density=reference["grain_density"],
            inertial_number=self.inertial_number)


def fill_box(law: Material, low: Any, high: Any, cell: float, **more: Any) -> mpm.Body:
    """Return a body of two particles per cell along each axis in a box [m]; more: fields of `mpm.Body`."""
    return mpm.Body(law, mpm.sample_box(low, high, cell / 2), volume=(cell / 2) ** 3, **more)


def set_up(body: mpm.Body, upper: Any, cell: float, lower: Any = (0, 0, 0), **scene: Any
           ) -> tuple[TimedSolver, mpm.Solver]:
    """Return a solver of a body on a grid between two corners [m], timed and by itself; scene: of `mpm.Solver`."""
    solver = mpm.Solver(grid=mpm.Grid(lower, upper, cell), bodies=[body], **scene)
    return TimedSolver(solver), solver


def resting_body(law: Material, positions: np.ndarray, volume: float) -> mpm.Body:
    """Return a bed with the stress of rest under its own weight; volume: of a particle [m^3]."""
    return mpm.Body(law, positions, volume=volume, stress=mpm.geostatic_stress(positions, volume, law))


def hydrostatic_stress(water: mpm.NewtonianFluid, depths: np.ndarray, gravity: float = 9.81) -> np.ndarray:
    """Return the stress [Pa] (n, 3, 3) of water at depths [m] (n,) below a surface that a solid may pierce."""
    return -water.density * gravity * depths[:, None, None] * np.eye(3)


def carry(timed: TimedSolver, displacement: Callable[[int], np.ndarray | list[float]], windows: int,
          window: float) -> Iterator[int]:
    """Move the first collider on, advance and yield, window [s] by window.
    displacement: from the start [m] (3,), after k windows."""
    start = here = timed.solver.collider_pose(0)
    for k in range(windows):
        there = mpm.Pose(start.position + displacement(k + 1), start.quaternion)
        timed.solver.set_collider_motion(0, here, there)
        timed.advance(window)
        yield k
        here = there


def rms(vectors: np.ndarray) -> float:
    """Return the root of the mean square of the lengths of vectors (n, d)."""
    return float(np.sqrt((vectors**2).sum(1).mean()))
