"""Sand: Drucker-Prager plasticity as a return mapping on Hencky strain, and friction that grows with the rate."""

import math
from dataclasses import dataclass

from mpm.backend import once, ti
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.elasticity import Hencky
from mpm.materials.material import check_range
from mpm.materials.yield_surface import map_onto_cone, map_onto_cone_back

CONES = ("compression", "plane_strain")


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Hencky):
    """Sand: Hencky elasticity inside a Drucker-Prager cone (Klar et al. 2016, ACM TOG 35(4):103), with the volume
    correction of Tampubolon et al. 2017 (TOG 36(4):105): stress-free expansion is reversed before pressure builds up.
    Raises InvalidValue for numbers out of range, UnknownName for another cone."""

    friction_angle_deg: float
    """Internal friction angle [deg], in [0, 90)."""
    cohesion: float = 0.0
    """Cohesion c [Pa] of Mohr and Coulomb. The strength in simple shear, where the normal stresses are zero, is
    c cos(phi) with the cone "plane_strain", 2 sqrt(3) cos(phi) / (3 - sin(phi)) c with "compression"."""
    tensile_strength: float = 0.0
    """Largest mean tension [Pa] that is carried, from 0 to cohesion / tan(friction angle), where the cone ends."""
    cone: str = "compression"
    """Match with Mohr-Coulomb: "compression", in triaxial compression (Klar et al. 2016), or "plane_strain"."""

    plastic = True
    has_volume_correction = True

    def __post_init__(self) -> None:
        super().__post_init__()
        name = type(self).__name__
        check_range(name, "friction_angle_deg", self.friction_angle_deg, 0.0, 90.0)
        check_range(name, "cohesion [Pa]", self.cohesion, 0.0, math.inf)
        if self.cone not in CONES:
            raise UnknownName("cone", self.cone, CONES)
        if self.cohesion > 0 and self.friction_angle_deg == 0:
            raise InvalidValue(f"{name}: cohesion needs a friction angle above 0; use VonMises for phi = 0")
        if not 0.0 <= self.tensile_strength <= self.apex_tension:
            raise InvalidValue(f"{name}: tensile_strength [Pa] = {self.tensile_strength:g}; accepted: 0 to "
                               f"{self.apex_tension:g}, which is cohesion / tan(friction_angle_deg)")

    @property
    def apex_tension(self) -> float:
        """Mean tension [Pa] at the apex of the cone."""
        return self.cohesion / math.tan(math.radians(self.friction_angle_deg)) if self.cohesion > 0 else 0.0

    @property
    def alpha(self) -> float:
        """Slope of the cone: |dev tau| = 3 alpha p on the yield surface."""
        return cone_slope(self.friction_angle_deg, self.cone)

    @property
    def parameters(self) -> tuple[float, ...]:
        """(mu, lam, strain slope of the cone, volumetric strains of its apex and of the largest tension)."""
        modulus = 3.0 * self.lam + 2.0 * self.mu
        slope = modulus / (2.0 * self.mu) * self.alpha
        return (self.mu, self.lam, slope, 3.0 * self.apex_tension / modulus, 3.0 * self.tensile_strength / modulus)

    @staticmethod
    @ti.func
    def soften(p: ti.template(), firm):
        """Return p of particles with a share of the stiffness; apex and largest tension keep their stress."""
        return [once(firm * p[0]), once(firm * p[1]), p[2], once(p[3] / firm), once(p[4] / firm)]

    @staticmethod
    @ti.func
    def soften_back(p: ti.template(), firm, bar: ti.template()):
        """Return the adjoints of p and of the share."""
        return [once(firm * bar[0]), once(firm * bar[1]), bar[2], once(bar[3] / firm), once(bar[4] / firm)], \
            p[0] * bar[0] + p[1] * bar[1] - (p[3] * bar[3] + p[4] * bar[4]) / (firm * firm)

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template(), dt):
        """Return (h, vc): scale the deviator onto the cone at constant volume, cut tension off."""
        return map_onto_cone(h, vc, p, dt, False)

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), dt, bar: ti.template(), vc_bar,
                            soft: ti.template()):
        """Return the adjoints of h, vc and p, from those of the mapped h and vc; soft: see `yielding_share`."""
        return map_onto_cone_back(h, vc, p, dt, bar, vc_bar, soft, False)


def cone_slope(angle_deg: float, cone: str) -> float:
    """Return the slope of a cone for a friction angle [deg]: |dev tau| = 3 slope p on the yield surface."""
    sine = math.sin(math.radians(angle_deg))
    if cone == "plane_strain":
        return math.sqrt(2.0) / 3.0 * sine
    return math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)


@dataclass(frozen=True, kw_only=True)
class MuIRheology(DruckerPrager):
    """Sand with mu(I) friction: m = m_s + (m_2 - m_s) / (1 + I0 / I) (Jop, Forterre and Pouliquen 2006, Nature
    441:727), I = rate of shear x grain diameter / sqrt(pressure / density of a grain).

    m is the ratio of shear stress to pressure that the cone carries in simple shear: of `friction_angle_deg` at rest,
    of `limit_angle_deg` at infinite rate. At rest it is `DruckerPrager`; cohesion does not grow with the rate. Raises
    InvalidValue for numbers out of range, UnknownName for another cone."""

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
    def soften(p: ti.template(), firm):
        q = DruckerPrager.soften(p, firm)
        return [q[0], q[1], q[2], q[3], q[4], p[5], once(p[6] * ti.sqrt(firm))]

    @staticmethod
    @ti.func
    def soften_back(p: ti.template(), firm, bar: ti.template()):
        root = ti.sqrt(firm)
        q, firm_bar = DruckerPrager.soften_back(p, firm, bar)
        return [q[0], q[1], q[2], q[3], q[4], bar[5], once(root * bar[6])], firm_bar + 0.5 * p[6] * bar[6] / root

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template(), dt):
        return map_onto_cone(h, vc, p, dt, True)

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), dt, bar: ti.template(), vc_bar,
                            soft: ti.template()):
        return map_onto_cone_back(h, vc, p, dt, bar, vc_bar, soft, True)
