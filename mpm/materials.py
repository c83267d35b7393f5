"""Material laws on Hencky strain: each is a return mapping h -> h and a stress h -> tau, element-wise and branch-free.

h is a list of six entries [xx, yy, zz, xy, xz, yz] (see `strain`), `p` the law's numbers in the order of `parameters`.
"""

import math
from dataclasses import dataclass

from mpm.backend import ti
from mpm.errors import InvalidValue, UnknownName
from mpm.strain import keep

CONES = ("compression", "plane_strain")
TINY = 1e-30
"""Guards 0/0 where a deviator vanishes; below the square of any strain that single precision can hold."""
MAX_VOLUME_CORRECTION = 0.5
"""Largest logarithmic expansion that a grain remembers and takes back when it is compressed again."""


def check_range(owner: str, name: str, value: float, low: float, high: float) -> None:
    """Raise InvalidValue unless low <= value < high."""
    if not (low <= value < high):
        raise InvalidValue(f"{owner}: {name} = {value:g} is outside [{low:g}, {high:g})")


@dataclass(frozen=True, kw_only=True)
class Elastic:
    """Hencky elasticity: tau = 2 mu h + lam tr(h) I.

    E: Young's modulus [Pa]. nu: Poisson's ratio. density: bulk density [kg/m^3].
    """

    E: float
    nu: float
    density: float

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
        """Numbers that the kernels read: (mu, lam, ...)."""
        return (self.mu, self.lam)

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template()):
        """Strain after plastic flow, and the expansion to remember."""
        return h, vc

    @staticmethod
    @ti.func
    def stress(h: ti.template(), p: ti.template()):
        """Kirchhoff stress [Pa]."""
        pressure = p[1] * (h[0] + h[1] + h[2])
        double_mu = 2.0 * p[0]
        return [keep(pressure + double_mu * h[0]), keep(pressure + double_mu * h[1]), keep(pressure + double_mu * h[2]),
                keep(double_mu * h[3]), keep(double_mu * h[4]), keep(double_mu * h[5])]


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Elastic):
    """Sand: Hencky elasticity inside a Drucker-Prager cone (Klar et al. 2016, ACM TOG 35(4):103), with the volume
    correction of Tampubolon et al. 2017 (TOG 36(4):105): expansion without stress is taken back before stress returns.

    friction_angle_deg: internal friction angle, [0, 90). cohesion [Pa]: shear strength without pressure; tension is
    carried up to cohesion / tan(friction angle) and cut off there. cone: "compression" matches Mohr-Coulomb in
    triaxial compression as Klar does, "plane_strain" matches it in plane strain.
    """

    friction_angle_deg: float
    cohesion: float = 0.0
    cone: str = "compression"

    has_volume_correction = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("DruckerPrager", "friction_angle_deg", self.friction_angle_deg, 0.0, 90.0)
        check_range("DruckerPrager", "cohesion [Pa]", self.cohesion, 0.0, math.inf)
        if self.cone not in CONES:
            raise UnknownName("cone", self.cone, CONES)
        if self.cohesion > 0 and self.friction_angle_deg == 0:
            raise InvalidValue("DruckerPrager: cohesion needs a friction angle above 0; use VonMises for phi = 0")

    @property
    def alpha(self) -> float:
        """Slope of the cone: |dev tau| = 3 alpha p on the yield surface."""
        sine = math.sin(math.radians(self.friction_angle_deg))
        if self.cone == "plane_strain":
            return math.sqrt(2.0) / 3.0 * sine
        return math.sqrt(2.0 / 3.0) * 2.0 * sine / (3.0 - sine)

    @property
    def parameters(self) -> tuple[float, ...]:
        """(mu, lam, strain slope of the cone, volumetric strain of its apex)."""
        slope = (3.0 * self.lam + 2.0 * self.mu) / (2.0 * self.mu) * self.alpha
        apex = 0.0
        if self.cohesion > 0:
            tension = self.cohesion / math.tan(math.radians(self.friction_angle_deg))
            apex = 3.0 * tension / (3.0 * self.lam + 2.0 * self.mu)
        return (self.mu, self.lam, slope, apex)

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template()):
        """Scale the deviator onto the cone (volume kept), or drop it at the apex; needs tr h and |dev h| only."""
        trace = h[0] + h[1] + h[2] + vc
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [keep(h[0] - mean), keep(h[1] - mean), keep(h[2] - mean)]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5]) + TINY)
        allowed = ti.max(p[2] * (p[3] - trace), 0.0)
        scale = ti.min(allowed / norm, 1.0)
        kept = ti.min(trace, p[3])
        third = kept / 3.0
        expansion = ti.min(trace - kept, MAX_VOLUME_CORRECTION)
        return [keep(third + scale * d[0]), keep(third + scale * d[1]), keep(third + scale * d[2]),
                keep(scale * h[3]), keep(scale * h[4]), keep(scale * h[5])], expansion
