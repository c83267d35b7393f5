"""Return mapping of single particles onto the Drucker-Prager cone.

Measured: errors of the principal stretches after a plastic step, and for thousands of random strains the distance from
the cone, the change of volume, and the strain left after separation. Reference: stretches evaluated in 50-digit
arithmetic, and the equations of the cone. The strains are set in the solver's state, so that the update is the field's.
"""

import numpy as np
from scipy.spatial.transform import Rotation

import mpm
from robosim.studies.verification.cases.case import Record, TimedSolver, case
from robosim.studies.verification.cases.expectations import Within
from robosim.studies.verification.cases.granular.slope import shear_ratio

E, NU, DENSITY, CELL, DT, RANDOM, SMALL = 3.537e5, 0.3, 1500.0, 0.1, 1e-5, 4000, 0.15


def rotation_matrix(axis: tuple[float, ...], angle: float) -> np.ndarray:
    """Return the rotation matrix (3, 3) of an angle [rad] about an axis."""
    return Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle).as_matrix()


VECTORS = (
    (30, [[0.99, 0.08, 0], [0, 0.985, 0.01], [0.005, 0, 1]],
     (0.9716549254930555, 0.9950670406256893, 1.0085764158389063)),
    (30, rotation_matrix((1, 2, 3), 0.7) @ np.diag([1.06, 0.97, 0.93]) @ rotation_matrix((0, 1, 1), -1.1).T,
     (0.9570316055093315, 0.9775200327763318, 1.0221358041351838)),
    (20, np.diag([1, 1, 0.9]), (0.91040192147800686, 0.99427076968015037, 0.99427076968015037)),
    (45, [[1, 0.2, 0], [0, 0.97, 0], [0, 0, 1]], (0.9540732863994636, 0.9933484499414169, 1.0235012557943168)),
    (30, 0.9 * np.eye(3), (0.9, 0.9, 0.9)),
    (30, np.diag([1.2, 1, 0.84]), (1, 1, 1)),
    (30, np.diag([0.2, 1, 2]), (0.3448647832876871, 0.8801934292701054, 1.3177499898842169)),
    (0, [[0.99, 0.03, 0], [0, 0.99, 0], [0, 0, 0.99]], (0.99, 0.99, 0.99)),
    (60, [[0.95, 0.3, 0], [0, 0.95, 0], [0, 0, 0.95]], (0.8117692030835671, 0.95, 1.1117692030835673)),
)
"""Friction angle [deg], deformation gradient, and principal stretches after the return mapping, rising."""


def make_sand(phi_deg: float) -> mpm.DruckerPrager:
    """Make the sand of a friction angle [deg]."""
    return mpm.DruckerPrager(E=E, nu=NU, density=DENSITY, friction_angle_deg=phi_deg)


def build_solver(phi_deg: float, n: int, precision: str, integrator: str | None) -> mpm.Solver:
    """Build a solver with n particles; their positions do not matter to a substep's strains."""
    positions = np.random.default_rng(0).uniform(0.4, 0.6, (n, 3))
    body = mpm.Body(make_sand(phi_deg), positions, volume=0.2**3 / n)
    return mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), CELL), bodies=[body], gravity=(0, 0, 0), dt=DT,
                      precision=precision, integrator=integrator)


def deform(timed: TimedSolver, before: dict[str, np.ndarray], F: np.ndarray) -> dict[str, np.ndarray]:
    """Return the state after a substep in which every particle is deformed by F (n, 3, 3) or (3, 3)."""
    rate = (F - np.eye(3)) / DT
    count = {"time": np.array(timed.solver.time), "steps": np.array(timed.solver.steps)}
    rates = np.broadcast_to(rate, (len(before["x"]), 3, 3)).reshape(-1, 9)
    state = before | count | {"C": rates.astype(before["C"].dtype)}
    timed.solver.load(state)
    timed.advance(DT)
    after = timed.solver.state()
    return before | {name: after[name] for name in ("e", "vc")}


def yielded_stretches(timed: TimedSolver, still: dict[str, np.ndarray], F: np.ndarray) -> np.ndarray:
    """Return the principal stretches (n, 3), rising, after a substep from b = F F^T."""
    e = np.broadcast_to(F @ np.swapaxes(F, -1, -2) - np.eye(3), (len(still["x"]), 3, 3))
    picked = np.stack([e[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], 1)
    return stretches(deform(timed, still | {"e": picked.astype(still["e"].dtype)}, np.eye(3)))


def tensors(e: np.ndarray) -> np.ndarray:
    """Return b (n, 3, 3) from the state's six numbers e = b - I (n, 6)."""
    return np.eye(3) + e.astype(float)[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def stretches(state: dict[str, np.ndarray]) -> np.ndarray:
    """Return the principal stretches (n, 3), rising."""
    return np.sqrt(np.linalg.eigvalsh(tensors(state["e"])))


@case(
    source="Klar et al. 2016, ACM Trans. Graph. 35(4):103, evaluated in 50-digit arithmetic",
    # the series is run for strains up to SMALL only, "auto" for all
    sweep=[{"precision": p, "integrator": i}
           for p, i in (("f64", "exact"), ("f32", "exact"), ("f32", "auto"), ("f32", "series"))],
    quick=[{"precision": p, "integrator": i} for p, i in (("f64", "exact"), ("f32", "auto"))],
    # for random strains the shear on the cone, the volume, and the strain left after separation, as logarithms. In
    # single precision b is rounded to 6e-8 of its largest entry: 5e-7 for a stretch of 3 next to one of 0.2 (b: 0.04)
    expectations=(*(Within("stretch", high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 2e-6))),
                  *(Within(name, high, {"precision": p}) for p, high in (("f64", 1e-12), ("f32", 2e-5))
                    for name in ("cone", "volume", "apart"))),
    main_error="stretch")
def measure(*, precision: str = "f64", integrator: str = "exact") -> Record:
    """Run the case; return the errors of the vectors and of the random strains.

    Random particles must carry at most the shear of the cone, and exactly that where they yield, and keep their volume
    where they do not separate.
    """
    option = None if integrator == "auto" else integrator
    solver = build_solver(30.0, RANDOM, precision, option)
    timed, still = TimedSolver(solver), solver.state()
    still["v"][:], still["C"][:] = 0.0, 0.0
    wrong = []
    for phi, F, expected in VECTORS:
        F = np.asarray(F, float)
        if integrator == "series" and np.abs(np.log(np.linalg.svd(F)[1])).max() > SMALL:
            continue
        solver.set_material(0, make_sand(phi))
        wrong.append(np.abs(yielded_stretches(timed, still, F)[0] - expected).max())
    solver.set_material(0, make_sand(30.0))
    rng = np.random.default_rng(1)
    span = (np.log(0.2), np.log(3.0)) if integrator != "series" else (-SMALL, SMALL)
    axes = Rotation.from_quat(rng.standard_normal((2 * RANDOM, 4))).as_matrix().reshape(2, RANDOM, 3, 3)
    trial = np.sort(rng.uniform(*span, (RANDOM, 3)))
    F = axes[0] @ (np.exp(trial)[:, :, None] * axes[1])
    h = np.log(yielded_stretches(timed, still, F))
    law, pressed = make_sand(30.0), trial.sum(1) < 0
    shear = np.linalg.norm(h - h.mean(1, keepdims=True), axis=1)
    alpha = np.sqrt(2.0) / 3.0 * shear_ratio(30.0, "compression")
    beyond = shear + (3 * law.lam + 2 * law.mu) / (2 * law.mu) * alpha * h.sum(1)
    yielded = pressed & (np.abs(h - trial).max(1) > 1e-3)
    cone = max(beyond[pressed].max(), -beyond[yielded].min()) if yielded.any() else np.inf
    errors = {"stretch": max(wrong), "cone": cone, "volume": np.abs(h.sum(1) - trial.sum(1))[pressed].max(),
              "apart": np.abs(h[~pressed]).max()}
    return timed.record(errors, vectors=len(wrong), yielded=int(yielded.sum()))
