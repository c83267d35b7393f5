"""Shear and plane-strain compression of a particle to flow at constant volume.

Measured: relative error of the shear ratio at the end of simple shear under constant pressure, or of compression under
constant lateral pressure; in shear, also the difference between the normal stresses. Reference: m3 = 3 alpha / sqrt(2).
"""

import numpy as np
from scipy.optimize import brentq

from robosim.studies.verification.cases.case import Record, TimedSolver, case, grid
from robosim.studies.verification.cases.expectations import each_within
from robosim.studies.verification.cases.granular.return_mapping import build_solver, deform, make_sand, tensors
from robosim.studies.verification.cases.granular.slope import shear_ratio

PRESSURE, STEP, STEPS = 1000.0, 2e-3, {"shear": 60, "passive": 300}
"""Pressure [Pa], strain per step, and number of steps of each path."""


def stress(law, state: dict[str, np.ndarray]) -> np.ndarray:  # noqa: ANN001
    """Return the Cauchy stress [Pa] (3, 3) of the first particle, by Hencky's law written out here."""
    b = tensors(state["e"])[0]
    values, axes = np.linalg.eigh(b)
    h = 0.5 * np.log(values)
    return (axes * (2 * law.mu * h + law.lam * h.sum())) @ axes.T / np.sqrt(np.linalg.det(b))


@case(
    source="Drucker-Prager flow at constant volume: m3 = 3 alpha / sqrt(2) in simple shear and in plane strain",
    sweep=grid(path=("shear", "passive"), phi_deg=(20.0, 30.0, 40.0)),
    quick=grid(path=("shear", "passive"), phi_deg=(30.0,)),
    expectations=each_within({"ratio": 0.01, "normal": 0.015}),
    main_error="ratio")
def measure(*, path: str = "shear", phi_deg: float = 30.0, precision: str = "f64") -> Record:
    """Run the case; return the errors of the shear ratio and of the normal stresses."""
    law, solver = make_sand(phi_deg), build_solver(phi_deg, 4, precision, "exact")
    timed, state = TimedSolver(solver), solver.state()
    state["v"][:], state["C"][:] = 0.0, 0.0
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
    m3, normal = shear_ratio(phi_deg, "compression"), np.diag(sigma)
    ratio = sigma[0, 1] / PRESSURE if path == "shear" else (normal[1] - normal[0]) / -(normal[1] + normal[0])
    errors = {"ratio": ratio / m3 - 1}
    if path == "shear":
        errors["normal"] = np.abs(normal / -PRESSURE - 1).max()
    return timed.record(errors, ratio=ratio)
