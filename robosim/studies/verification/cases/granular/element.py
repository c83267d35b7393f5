"""Single particles: return mapping onto the Drucker-Prager cone, and paths to flow at constant volume."""

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

import mpm
from robosim.studies.verification.cases.beds import shear_ratio
from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import Within, each_within

E, NU, DENSITY, CELL, DT, RANDOM, SMALL = 3.537e5, 0.3, 1500.0, 0.1, 1e-5, 4000, 0.15
PRESSURE, STEP, STEPS = 1000.0, 2e-3, {"shear": 60, "passive": 300}
"""Pressure [Pa], strain per step, and number of steps of each path."""
FIRST, SECOND = (Rotation.from_rotvec(angle * np.array(axis) / np.linalg.norm(axis)).as_matrix()
                 for axis, angle in (((1, 2, 3), 0.7), ((0, 1, 1), -1.1)))
VECTORS = (
    (30, [[0.99, 0.08, 0], [0, 0.985, 0.01], [0.005, 0, 1]],
     (0.9716549254930555, 0.9950670406256893, 1.0085764158389063)),
    (30, FIRST @ np.diag([1.06, 0.97, 0.93]) @ SECOND.T, (0.9570316055093315, 0.9775200327763318, 1.0221358041351838)),
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


def build_solver(phi_deg: float, n: int, precision: str, integrator: str | None
                 ) -> tuple[TimedSolver, dict[str, np.ndarray]]:
    """Build a solver with n particles, and its state at rest; positions do not matter to a substep's strains."""
    positions = np.random.default_rng(0).uniform(0.4, 0.6, (n, 3))
    body = mpm.Body(make_sand(phi_deg), positions, volume=0.2**3 / n)
    solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), CELL), bodies=[body], gravity=(0, 0, 0), dt=DT,
                        precision=precision, integrator=integrator, transfer_interval=0.0)  # no kick before the strain
    state = solver.state()
    state["v"][:], state["C"][:] = 0.0, 0.0
    return TimedSolver(solver), state


def deform(timed: TimedSolver, before: dict[str, np.ndarray], F: np.ndarray) -> dict[str, np.ndarray]:
    """Return the state after a substep in which every particle is deformed by F (n, 3, 3) or (3, 3)."""
    rate = (F - np.eye(3)) / DT
    count = {"time": np.array(timed.solver.time), "steps": np.array(timed.solver.steps)}
    rates = np.broadcast_to(rate, (len(before["x"]), 3, 3)).reshape(-1, 9)
    timed.solver.load(before | count | {"C": rates.astype(before["C"].dtype)})
    timed.advance(DT)
    after = timed.solver.state()
    return before | {name: after[name] for name in ("e", "vc")}


def yielded_stretches(timed: TimedSolver, still: dict[str, np.ndarray], F: np.ndarray) -> np.ndarray:
    """Return the principal stretches (n, 3), rising, after a substep from b = F F^T."""
    e = np.broadcast_to(F @ np.swapaxes(F, -1, -2) - np.eye(3), (len(still["x"]), 3, 3))
    picked = np.stack([e[:, i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], 1)
    state = deform(timed, still | {"e": picked.astype(still["e"].dtype)}, np.eye(3))
    return np.sqrt(np.linalg.eigvalsh(tensors(state["e"])))


def tensors(e: np.ndarray) -> np.ndarray:
    """Return b (n, 3, 3) from the state's six numbers e = b - I (n, 6)."""
    return np.eye(3) + e.astype(float)[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]


def stress(law, state: dict[str, np.ndarray]) -> np.ndarray:  # noqa: ANN001
    """Return the Cauchy stress [Pa] (3, 3) of the first particle, by Hencky's law written out here."""
    b = tensors(state["e"])[0]
    values, axes = np.linalg.eigh(b)
    h = 0.5 * np.log(values)
    return (axes * (2 * law.mu * h + law.lam * h.sum())) @ axes.T / np.sqrt(np.linalg.det(b))


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
def return_mapping(*, precision: str = "f64", integrator: str = "exact") -> Record:
    """Return mapping of single particles onto the Drucker-Prager cone.

    Measured: errors of the principal stretches after a plastic step, and for thousands of random strains the distance
    from the cone, the change of volume, and the strain left after separation: they must carry at most the shear of the
    cone, and exactly that where they yield, and keep their volume where they do not separate. The strains are set in
    the solver's state, so that the update is the field's."""
    timed, still = build_solver(30.0, RANDOM, precision, None if integrator == "auto" else integrator)
    wrong = []
    for phi, F, expected in VECTORS:
        F = np.asarray(F, float)
        if integrator == "series" and np.abs(np.log(np.linalg.svd(F)[1])).max() > SMALL:
            continue
        timed.solver.set_material(0, make_sand(phi))
        wrong.append(np.abs(yielded_stretches(timed, still, F)[0] - expected).max())
    law, rng = make_sand(30.0), np.random.default_rng(1)
    timed.solver.set_material(0, law)
    span = (np.log(0.2), np.log(3.0)) if integrator != "series" else (-SMALL, SMALL)
    axes = Rotation.from_quat(rng.standard_normal((2 * RANDOM, 4))).as_matrix().reshape(2, RANDOM, 3, 3)
    trial = np.sort(rng.uniform(*span, (RANDOM, 3)))
    h = np.log(yielded_stretches(timed, still, axes[0] @ (np.exp(trial)[:, :, None] * axes[1])))
    pressed = trial.sum(1) < 0
    shear = np.linalg.norm(h - h.mean(1, keepdims=True), axis=1)
    alpha = np.sqrt(2.0) / 3.0 * shear_ratio(30.0)
    beyond = shear + (3 * law.lam + 2 * law.mu) / (2 * law.mu) * alpha * h.sum(1)
    yielded = pressed & (np.abs(h - trial).max(1) > 1e-3)
    cone = max(beyond[pressed].max(), -beyond[yielded].min()) if yielded.any() else np.inf
    errors = {"stretch": max(wrong), "cone": cone, "volume": np.abs(h.sum(1) - trial.sum(1))[pressed].max(),
              "apart": np.abs(h[~pressed]).max()}
    return timed.record(errors, vectors=len(wrong), yielded=int(yielded.sum()))


@case(
    source="Drucker-Prager flow at constant volume: m3 = 3 alpha / sqrt(2) in simple shear and in plane strain",
    sweep=grid(path=("shear", "passive"), phi_deg=(20.0, 30.0, 40.0)),
    quick=grid(path=("shear", "passive"), phi_deg=(30.0,)),
    expectations=each_within({"ratio": 0.01, "normal": 0.015}), main_error="ratio")
def element_path(*, path: str = "shear", phi_deg: float = 30.0, precision: str = "f64") -> Record:
    """Shear and plane-strain compression of a particle to flow at constant volume.

    Measured: relative error of the shear ratio at the end of simple shear under constant pressure, or of compression
    under constant lateral pressure; in shear, also the difference between the normal stresses."""
    law, (timed, state) = make_sand(phi_deg), build_solver(phi_deg, 4, precision, "exact")
    state["e"][:, :3] = np.expm1(-2.0 / 3.0 * PRESSURE / (law.lam + 2.0 / 3.0 * law.mu))

    def step_gradient(stretch: float) -> np.ndarray:
        """Return the deformation gradient of a step; the stretch along y keeps the pressure."""
        return np.array([[1.0, STEP, 0.0], [0.0, stretch, 0.0], [0.0, 0.0, 1.0]]) if path == "shear" \
            else np.diag([1.0 - 0.5 * STEP, stretch, 1.0])

    def pressure_error(stretch: float, before: dict[str, np.ndarray]) -> float:
        return float(stress(law, deform(timed, before, step_gradient(stretch)))[1, 1] + PRESSURE)

    for _ in range(STEPS[path]):
        stretch = brentq(pressure_error, 0.99, 1.01, args=(state,), xtol=1e-11)
        state = deform(timed, state, step_gradient(float(stretch)))  # pyright: ignore[reportArgumentType]
    sigma = stress(law, state)
    m3, normal = shear_ratio(phi_deg), np.diag(sigma)
    ratio = sigma[0, 1] / PRESSURE if path == "shear" else (normal[1] - normal[0]) / -(normal[1] + normal[0])
    errors = {"ratio": ratio / m3 - 1}
    if path == "shear":
        errors["normal"] = np.abs(normal / -PRESSURE - 1).max()
    return timed.record(errors, ratio=ratio)
