"""One pack of a material driven through the constitutive update and through its adjoint, outside any grid."""

import numpy as np

import mpm
from mpm.adjoint.node_tape import ParticleAdjoints
from mpm.adjoint.stress_update import ForwardIntermediates, recompute, stress_back, write_list
from mpm.backend import default_precision, once, ti
from mpm.materials.hencky_strain import hencky_exact
from mpm.materials.material import PARAMETERS
from mpm.materials.stress_update import update_stress
from mpm.state.packs import LANES

DT = 1e-3


@ti.data_oriented
class AdjointElement:
    """State (LANES, k), velocity gradient (LANES, 9), parameters (8,) -> stress (LANES, 6), state; and the adjoint."""

    def __init__(self, material, **options) -> None:
        body = mpm.Body(material, np.full((LANES, 3), 0.5) + 0.01 * np.arange(LANES)[:, None], volume=1e-6)
        self.solver = mpm.Solver(grid=mpm.Grid((0, 0, 0), (1, 1, 1), 0.1), bodies=[body], precision="f64")
        self.P, self.law = self.solver.particles, material
        self.B, self.T = ParticleAdjoints(self.P, "f64"), ForwardIntermediates((material,), 1, "f64", **options)
        fields = self.solver.fields
        self.logarithm, self.exponential, self.features = fields.logarithm, fields.exponential, fields.features
        self.names = [name for name in ("e", "j", "vc") if name in self.P.named_fields()]
        assert self.logarithm is hencky_exact

    def _state(self, particles) -> list:
        return [field for name in self.names for field in particles.named_fields()[name]]

    @property
    def size(self) -> int:
        return len(self._state(self.P))

    def forward(self, state: np.ndarray, C: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return stress / Pa and new state (LANES, 6 + k)."""
        for field, column in zip(self._state(self.P), state.T):
            field.from_numpy(column[None].copy())
        out = np.zeros((LANES, 6))
        with default_precision("f64"):
            self._forward(C, p, out)
        new = [field.to_numpy()[0] for field in self._state(self.P)]
        return np.column_stack([out, *new])

    @ti.kernel
    def _forward(self, C: ti.types.ndarray(), p: ti.types.ndarray(), out: ti.types.ndarray()):
        for _ in range(1):
            rates = [once(ti.Vector([C[l, i] for l in range(LANES)])) for i in range(9)]
            tau = update_stress(self, self.P, self.law, 0, DT, rates, [once(p[i]) for i in range(PARAMETERS)])
            for i in ti.static(range(6)):
                for l in ti.static(range(LANES)):
                    out[l, i] = tau[i][l]

    def backward(self, state: np.ndarray, C: np.ndarray, p: np.ndarray, bar: np.ndarray) -> tuple:
        """Return the adjoints of state (LANES, k), C (LANES, 9) and p (8,) from those of the result of `forward`."""
        for field, column in zip(self._state(self.P), state.T):
            field.from_numpy(column[None].copy())
        for field, column in zip(self._state(self.B), bar[:, 6:].T):
            field.from_numpy(column[None].copy())
        C_bar, p_bar = np.zeros((LANES, 9)), np.zeros(8)
        with default_precision("f64"):
            self._backward(C, p, bar[:, :6].copy(), C_bar, p_bar)
        return np.column_stack([field.to_numpy()[0] for field in self._state(self.B)]), C_bar, p_bar

    @ti.kernel
    def _backward(self, C: ti.types.ndarray(), p: ti.types.ndarray(), tau_bar: ti.types.ndarray(),
                  C_bar: ti.types.ndarray(), p_bar: ti.types.ndarray()):
        for _ in range(1):
            rates = [once(ti.Vector([C[l, i] for l in range(LANES)])) for i in range(9)]
            bars = [once(ti.Vector([tau_bar[l, i] for l in range(LANES)])) for i in range(6)]
            numbers = [once(p[i]) for i in range(PARAMETERS)]
            recompute(self.P, self.T, self.law, 0, DT, rates, numbers)
            write_list(self.T.tau, 0, bars)
            rates_bar, numbers_bar = stress_back(self.P, self.B, self.T, self.law, 0, DT, rates, numbers)
            for i in ti.static(range(9)):
                for l in ti.static(range(LANES)):
                    C_bar[l, i] = rates_bar[i][l]
            for i in ti.static(range(len(numbers_bar))):
                p_bar[i] = numbers_bar[i].sum()
