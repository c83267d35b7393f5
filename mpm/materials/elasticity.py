"""Elastic laws: Hencky, neo-Hookean, fixed corotated."""

import math
from dataclasses import dataclass

import numpy as np

from mpm.backend import once, ti
from mpm.errors import UnknownName
from mpm.materials.material import check_range
from mpm.materials.symmetric_tensor import (
    JACOBI_SWEEPS,
    combine,
    determinant_minus_one,
    inverse,
    spectrum,
    square_root,
)
from mpm.materials.tensor_adjoint import root_back


@dataclass(frozen=True, kw_only=True)
class Hencky:
    """Hencky elasticity: tau = 2 mu h + lam tr(h) I; the base of all solids."""

    E: float
    """Young's modulus [Pa]."""
    nu: float
    """Poisson's ratio [-], in [0, 0.5)."""
    density: float
    """Bulk density [kg/m^3]."""

    state = "hencky"
    plastic = False
    has_volume_correction = False

    def __post_init__(self) -> None:
        name = type(self).__name__
        check_range(name, "E [Pa]", self.E, 1e-9, math.inf)
        check_range(name, "nu", self.nu, 0.0, 0.5)
        check_range(name, "density [kg/m^3]", self.density, 1e-9, math.inf)

    @property
    def mu(self) -> float:
        """Shear modulus [Pa]."""
        return self.E / (2.0 * (1.0 + self.nu))

    @property
    def lam(self) -> float:
        """Lame's first parameter [Pa]."""
        return self.E * self.nu / ((1.0 + self.nu) * (1.0 - 2.0 * self.nu))

    @property
    def parameters(self) -> tuple[float, ...]:
        """Parameters that the kernels read: (mu, lam)."""
        return (self.mu, self.lam)

    def energy_density(self, stretches: np.ndarray) -> np.ndarray:
        """Return the elastic energy [J/m^3] of the unstrained volume (n,) at principal stretches (n, 3)."""
        h = np.log(stretches)
        return self.mu * (h**2).sum(1) + 0.5 * self.lam * h.sum(1) ** 2

    @staticmethod
    @ti.func
    def stress(h: ti.template(), p: ti.template()):
        """Return the Kirchhoff stress [Pa], six entries."""
        pressure = p[1] * (h[0] + h[1] + h[2])
        double_mu = 2.0 * p[0]
        return [once(pressure + double_mu * h[0]), once(pressure + double_mu * h[1]), once(pressure + double_mu * h[2]),
                once(double_mu * h[3]), once(double_mu * h[4]), once(double_mu * h[5])]

    @staticmethod
    @ti.func
    def stress_back(h: ti.template(), p: ti.template(), bar: ti.template()):
        """Return the adjoints of the state and of p, from that of the stress."""
        trace = bar[0] + bar[1] + bar[2]
        state = [once(2.0 * p[0] * bar[i] + (p[1] * trace if ti.static(i < 3) else 0.0)) for i in range(6)]
        along = h[0] * bar[0] + h[1] * bar[1] + h[2] * bar[2] + h[3] * bar[3] + h[4] * bar[4] + h[5] * bar[5]
        return state, [2.0 * along, (h[0] + h[1] + h[2]) * trace]


@dataclass(frozen=True, kw_only=True)
class NeoHookean(Hencky):
    """tau = mu (b - I) + lam log(J) I, as in Bonet & Wood; needs neither logarithm nor root of a tensor."""

    state = "cauchy_green"

    def energy_density(self, stretches: np.ndarray) -> np.ndarray:
        swelling = np.log(stretches).sum(1)
        return self.mu * (0.5 * ((stretches**2).sum(1) - 3.0) - swelling) + 0.5 * self.lam * swelling**2

    @staticmethod
    @ti.func
    def stress(e: ti.template(), p: ti.template()):
        return combine(p[0], 0.5 * p[1] * ti.log(1.0 + determinant_minus_one(e)), e)

    @staticmethod
    @ti.func
    def stress_back(e: ti.template(), p: ti.template(), bar: ti.template()):
        """Return the adjoints of the state and of p, from that of the stress; d log det b = tr(b^-1 db)."""
        trace = bar[0] + bar[1] + bar[2]
        b_inverse = inverse(combine(1.0, 1.0, e))
        half = 0.5 * p[1] * trace
        state = [once(p[0] * bar[i] + half * b_inverse[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        along = e[0] * bar[0] + e[1] * bar[1] + e[2] * bar[2] + e[3] * bar[3] + e[4] * bar[4] + e[5] * bar[5]
        return state, [along, 0.5 * ti.log(1.0 + determinant_minus_one(e)) * trace]


@dataclass(frozen=True, kw_only=True)
class FixedCorotated(Hencky):
    """tau = 2 mu (b - V) + lam (J - 1) J I with V the root of b (Stomakhin et al. 2012, SCA), without an SVD."""

    state = "cauchy_green"

    def energy_density(self, stretches: np.ndarray) -> np.ndarray:
        swelling = stretches.prod(1) - 1.0
        return self.mu * ((stretches - 1.0) ** 2).sum(1) + 0.5 * self.lam * swelling**2

    @staticmethod
    @ti.func
    def stress(e: ti.template(), p: ti.template()):
        stretch = square_root(e)
        J = ti.sqrt(1.0 + determinant_minus_one(e))
        volumetric = p[1] * (J - 1.0) * J
        return [once(2.0 * p[0] * (e[0] - stretch[0]) + volumetric),
                once(2.0 * p[0] * (e[1] - stretch[1]) + volumetric),
                once(2.0 * p[0] * (e[2] - stretch[2]) + volumetric), once(2.0 * p[0] * (e[3] - stretch[3])),
                once(2.0 * p[0] * (e[4] - stretch[4])), once(2.0 * p[0] * (e[5] - stretch[5]))]

    @staticmethod
    @ti.func
    def stress_back(e: ti.template(), p: ti.template(), bar: ti.template()):
        """Return the adjoints of the state and of p, from that of the stress; dJ = J tr(b^-1 db) / 2."""
        trace = bar[0] + bar[1] + bar[2]
        d, v = spectrum(e, JACOBI_SWEEPS)
        through_stretch = root_back(d, v, bar)
        J = ti.sqrt(1.0 + determinant_minus_one(e))
        b_inverse = inverse(combine(1.0, 1.0, e))
        volumetric = 0.5 * p[1] * (2.0 * J - 1.0) * J * trace
        state = [once(2.0 * p[0] * (bar[i] - through_stretch[i])
                      + volumetric * b_inverse[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        s = square_root(e)
        along = (e[0] - s[0]) * bar[0] + (e[1] - s[1]) * bar[1] + (e[2] - s[2]) * bar[2] \
            + (e[3] - s[3]) * bar[3] + (e[4] - s[4]) * bar[4] + (e[5] - s[5]) * bar[5]
        return state, [2.0 * along, (J - 1.0) * J * trace]


ELASTIC_MODELS = {"hencky": Hencky, "neo_hookean": NeoHookean, "fixed_corotated": FixedCorotated}
"""Name -> law, for `Elastic`."""


def Elastic(*, E: float, nu: float, density: float, model: str = "hencky") -> Hencky:
    """Make an elastic material by the name of its law.
    E: Young's modulus [Pa]. nu: Poisson's ratio. density: [kg/m^3]. model: "hencky", "neo_hookean" or
    "fixed_corotated". Raises UnknownName, and InvalidValue for a number out of range."""
    if model not in ELASTIC_MODELS:
        raise UnknownName("elastic model", model, ELASTIC_MODELS)
    return ELASTIC_MODELS[model](E=E, nu=nu, density=density)
