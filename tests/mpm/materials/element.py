"""A single material point driven through its law, outside any grid."""

import numpy as np

from mpm.backend import default_precision, real_type, ti
from mpm.materials.hencky_strain import INTEGRATORS


class Element:
    """Applies deformation gradients to one point of a material, in one precision and with one integrator."""

    def __init__(self, material, precision: str = "f64", integrator: str = "exact") -> None:
        self.material, self.precision = material, precision
        self.dtype = np.float64 if precision == "f64" else np.float32
        self.parameters = np.pad(material.parameters, (0, 8 - len(material.parameters))).astype(self.dtype)
        real = real_type(precision)
        logarithm, exponential = INTEGRATORS[integrator]

        @ti.kernel
        def update(e: ti.types.ndarray(), vc: real, p: ti.types.ndarray(), dt: real, out: ti.types.ndarray()):
            for _ in range(1):
                if ti.static(material.state == "cauchy_green"):
                    tau = material.stress([e[i] for i in range(6)], [p[i] for i in range(8)])
                    for i in ti.static(range(6)):
                        out[1, i] = e[i]
                        out[2, i] = tau[i]
                else:
                    trial = logarithm([e[i] for i in range(6)])
                    if ti.static(material.plastic):
                        h, expansion = material.return_mapping(trial, vc, [p[i] for i in range(8)], dt)
                        back = exponential(h)
                        tau = material.stress(h, [p[i] for i in range(8)])
                        for i in ti.static(range(6)):
                            out[1, i] = back[i]
                            out[2, i] = tau[i]
                        out[3, 0] = expansion
                    else:
                        tau = material.stress(trial, [p[i] for i in range(8)])
                        for i in ti.static(range(6)):
                            out[1, i] = e[i]
                            out[2, i] = tau[i]

        self._update = update
        self.b, self.vc, self.tau = np.eye(3), 0.0, np.zeros((3, 3))

    def apply(self, F: np.ndarray, dt: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Singular values of the elastic F afterwards (3,) and eigenvalues of tau [Pa] (3,), both descending."""
        b = F @ self.b @ F.T
        e = (b - np.eye(3))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]].astype(self.dtype)
        out = np.zeros((4, 6), self.dtype)
        with default_precision(self.precision):
            self._update(e, self.vc, self.parameters, dt, out)
        self.b, self.vc = np.eye(3) + symmetric(out[1]), float(out[3, 0])
        self.tau = symmetric(out[2])
        return np.sqrt(np.linalg.eigvalsh(self.b))[::-1], np.linalg.eigvalsh(self.tau)[::-1]


def symmetric(entries: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of [xx, yy, zz, xy, xz, yz]."""
    return np.asarray(entries, float)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
