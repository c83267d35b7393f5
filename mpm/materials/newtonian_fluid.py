"""Newtonian fluid: pressure from the change of volume, viscosity from the rate of shear."""

import math
from dataclasses import dataclass
from typing import Literal

from mpm.backend import once, ti
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.elasticity import check_range

RATES = ("particle", "cell")
"""Accepted values of `NewtonianFluid.volume_rate`."""

@dataclass(frozen=True, kw_only=True)
class NewtonianFluid:
    """Newtonian fluid: tau = bulk_modulus (J - 1) J I + 2 viscosity J dev(D), D the rate of deformation [1/s].
    Raises InvalidValue for arguments out of range, UnknownName for a volume_rate that is not in RATES."""

    bulk_modulus: float
    """Bulk modulus [Pa]."""
    density: float
    """Density [kg/m^3]."""
    viscosity: float = 0.0
    """Dynamic viscosity [Pa s]."""
    tension: bool = True
    """Whether expanded fluid pulls; False: no pressure where J > 1, so that drops part freely."""
    volume_rate: Literal["particle", "cell"] = "particle"
    """Rate of volume that J follows: the particle's own, or the mean of the particles in its cell."""

    state = "volume"
    plastic = False
    has_volume_correction = False

    def __post_init__(self) -> None:
        check_range("NewtonianFluid", "bulk_modulus [Pa]", self.bulk_modulus, 1e-9, math.inf)
        check_range("NewtonianFluid", "density [kg/m^3]", self.density, 1e-9, math.inf)
        check_range("NewtonianFluid", "viscosity [Pa s]", self.viscosity, 0.0, math.inf)
        if not isinstance(self.tension, bool):
            raise InvalidValue(f"NewtonianFluid: tension = {self.tension!r}; accepted: True or False")
        if self.volume_rate not in RATES:
            raise UnknownName("volume_rate", self.volume_rate, RATES)

    @property
    def mu(self) -> float:
        """Shear modulus [Pa]: zero."""
        return 0.0

    @property
    def lam(self) -> float:
        """Lame's first parameter [Pa]: the bulk modulus."""
        return self.bulk_modulus

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters that the kernels read: (bulk modulus, viscosity, share of the first in tension: 1 or 0)."""
        return (self.bulk_modulus, self.viscosity, float(self.tension))

    @staticmethod
    @ti.func
    def stress(j: ti.template(), C: ti.template(), p: ti.template()):
        """Return the Kirchhoff stress [Pa] from j = J - 1 and the velocity gradient C, row by row."""
        J = 1.0 + j
        pressure = p[0] * (ti.min(j, 0.0) + p[2] * ti.max(j, 0.0)) * J
        shear = p[1] * J
        third = (C[0] + C[4] + C[8]) / 3.0
        return [once(pressure + 2.0 * shear * (C[0] - third)), once(pressure + 2.0 * shear * (C[4] - third)),
                once(pressure + 2.0 * shear * (C[8] - third)), once(shear * (C[1] + C[3])), once(shear * (C[2] + C[6])),
                once(shear * (C[5] + C[7]))]

    @staticmethod
    @ti.func
    def stress_back(j: ti.template(), C: ti.template(), p: ti.template(), bar: ti.template()):
        """Return the adjoints of j, of C (nine entries) and of p, from that of the stress."""
        J = 1.0 + j
        third = (C[0] + C[4] + C[8]) / 3.0
        trace = bar[0] + bar[1] + bar[2]
        shear = 2.0 * ((C[0] - third) * bar[0] + (C[4] - third) * bar[1] + (C[8] - third) * bar[2]) \
            + (C[1] + C[3]) * bar[3] + (C[2] + C[6]) * bar[4] + (C[5] + C[7]) * bar[5]
        rate = p[1] * J
        x, y, z = rate * bar[3], rate * bar[4], rate * bar[5]
        C_bar = [once(2.0 * rate * (bar[0] - trace / 3.0)), x, y, x, once(2.0 * rate * (bar[1] - trace / 3.0)), z,
                 y, z, once(2.0 * rate * (bar[2] - trace / 3.0))]
        strain, stretch = ti.min(j, 0.0) + p[2] * ti.max(j, 0.0), ti.max(j, 0.0)
        slope = ti.select(j > 0.0, p[2], 1.0)
        return (once(p[0] * (slope * J + strain) * trace + p[1] * shear), C_bar,
                [strain * J * trace, J * shear, p[0] * stretch * J * trace])
