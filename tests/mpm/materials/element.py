"""A single material point driven through its law, outside any grid."""

import numpy as np

from mpm.backend import default_precision, ti
from mpm.materials.hencky_strain import INTEGRATORS


class Element:
    """Applies deformation gradients to one point of a material, in double precision and with eigenvalues."""

    def __init__(self, material) -> None:
        self.parameters = np.pad(material.parameters, (0, 8 - len(material.parameters)))
        logarithm, exponential = INTEGRATORS["exact"]

        @ti.func
        def write(to: ti.template(), values: ti.template()):
            for i in ti.static(range(6)):
                to[i] = values[i]

        @ti.kernel
        def update(e: ti.types.ndarray(), volume: ti.types.ndarray(), p: ti.types.ndarray(), dt: ti.f64,
                   tau: ti.types.ndarray()):
            for _ in range(1):
                numbers = [p[i] for i in range(8)]
                if ti.static(material.state == "cauchy_green"):
                    write(tau, material.stress([e[i] for i in range(6)], numbers))
                else:
                    h = logarithm([e[i] for i in range(6)])
                    if ti.static(material.plastic):
                        mapped, volume[0] = material.return_mapping(h, volume[0], numbers, dt)
                        write(e, exponential(mapped))
                        write(tau, material.stress(mapped, numbers))
                    else:
                        write(tau, material.stress(h, numbers))

        self._update = update
        self.b, self.vc, self.tau = np.eye(3), 0.0, np.zeros((3, 3))

    def apply(self, F: np.ndarray, dt: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
        """Singular values of the elastic F afterwards (3,) and eigenvalues of tau [Pa] (3,), both descending."""
        e = (F @ self.b @ F.T - np.eye(3))[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        volume, tau = np.full(1, self.vc), np.zeros(6)
        with default_precision("f64"):
            self._update(e, volume, self.parameters, dt, tau)
        self.b, self.vc, self.tau = np.eye(3) + symmetric(e), float(volume[0]), symmetric(tau)
        return np.sqrt(np.linalg.eigvalsh(self.b))[::-1], np.linalg.eigvalsh(self.tau)[::-1]


def symmetric(entries: np.ndarray) -> np.ndarray:
    """Matrix (3, 3) of [xx, yy, zz, xy, xz, yz]."""
    return np.asarray(entries, float)[[[0, 3, 4], [3, 1, 5], [4, 5, 2]]]
