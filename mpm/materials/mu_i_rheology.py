"""The mu(I) rheology: sand whose friction grows with the rate of shear."""

import math
from dataclasses import dataclass

from mpm.backend import ti
from mpm.errors import InvalidValue
from mpm.materials.drucker_prager import DruckerPrager, cone_slope
from mpm.materials.material import check_range
from mpm.materials.yield_surface import map_onto_cone, map_onto_cone_back


@dataclass(frozen=True, kw_only=True)
class MuIRheology(DruckerPrager):
    """Sand with mu(I) friction: m = m_s + (m_2 - m_s) / (1 + I0 / I) (Jop, Forterre and Pouliquen 2006, Nature
    441:727), I = rate of shear x grain diameter / sqrt(pressure / density of a grain).

    m is the ratio of shear stress to pressure that the cone carries in simple shear: of `friction_angle_deg` at rest,
    of `limit_angle_deg` at infinite rate. At rest it is `DruckerPrager`; cohesion does not grow with the rate. Raises
    InvalidValue for numbers out of range, UnknownName for another cone.
    """

    limit_angle_deg: float
    """Friction angle [deg] at infinite rate, not below `friction_angle_deg`, below 90."""
    grain_diameter: float
    """[m]"""
    grain_density: float
    """Density [kg/m^3] of a grain itself, not of the bulk."""
    inertial_number: float = 0.279
    """Inertial number I0 at which friction is half way; by default that of glass beads."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, unit in (("grain_diameter", " [m]"), ("grain_density", " [kg/m^3]"), ("inertial_number", "")):
            check_range("MuIRheology", name + unit, getattr(self, name), 1e-12, math.inf)
        if not 0.0 < self.friction_angle_deg <= self.limit_angle_deg < 90.0:
            raise InvalidValue(f"MuIRheology: friction_angle_deg = {self.friction_angle_deg:g}, limit_angle_deg = "
                               f"{self.limit_angle_deg:g}; accepted: 0 < friction_angle_deg <= limit_angle_deg < 90")

    @property
    def parameters(self) -> tuple[float, ...]:
        """Those of `DruckerPrager`, and R and kappa [1/s] of `yield_surface`."""
        ratio = cone_slope(self.limit_angle_deg, self.cone) / self.alpha
        # |dev h| of the substep is rate x dt / sqrt(2); the pressure is bulk modulus x -trace
        bulk = self.lam + 2.0 / 3.0 * self.mu
        kappa = math.sqrt(bulk / self.grain_density) * self.inertial_number / (math.sqrt(2.0) * self.grain_diameter)
        return (*super().parameters, ratio, kappa)

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template(), dt):
        """Return (h, vc) after the flow of dt [s]."""
        return map_onto_cone(h, vc, p, dt, True)

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), dt, bar: ti.template(), vc_bar,
                            soft: ti.template()):
        """Return the adjoints of h, vc and p."""
        return map_onto_cone_back(h, vc, p, dt, bar, vc_bar, soft, True)
