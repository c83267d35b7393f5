"""Sand that is denser than in its critical state: friction above the critical one, which falls as it dilates."""

# pyright: reportInvalidTypeForm=false
# annotations of Taichi functions are objects
import math
from dataclasses import dataclass

from mpm.backend import once, ti
from mpm.materials.elasticity import Hencky
from mpm.materials.material import check_range
from mpm.materials.yield_surface import MAX_VOLUME_CORRECTION, TINY

LARGEST_J3 = 0.3849
"""J3 over J2^1.5 at most: 2 / sqrt(27), in triaxial compression."""
LOOSEST, DENSEST = 0.85, 0.55
"""Void ratios of quartz sand at relative densities 0 and 1, to be checked."""


@dataclass(frozen=True, kw_only=True)
class DenseSand(Hencky):
    """Sand with the surface of Matsuoka and Nakai (1974), which has one angle in triaxial compression and extension.

    At the start the angle is `peak_angle_deg`. Shear dilates the sand by `dilation` per shear strain; both excess of
    friction and dilation fall in proportion to what is left of `room`, and vanish with it (critical state). Sand that
    separates is in the critical state when it meets again. Source: stress and dilatancy of Bolton (1986), Geotechnique
    36:65. It has no adjoint. Raises InvalidValue for numbers out of range."""

    friction_angle_deg: float
    """Critical friction angle [deg] in triaxial compression, above 0, below 50."""
    peak_angle_deg: float
    """Friction angle [deg] at the initial density, not below the critical one, below 50."""
    dilation: float
    """Volume strain per shear strain at the initial density, in [0, 1)."""
    room: float
    """Logarithmic volume strain from the initial to the critical density, above 0, below 0.5."""

    plastic = True
    has_volume_correction = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("DenseSand", "friction_angle_deg", self.friction_angle_deg, 1e-3, 50.0)
        check_range("DenseSand", "peak_angle_deg", self.peak_angle_deg, self.friction_angle_deg, 50.0)
        check_range("DenseSand", "dilation", self.dilation, 0.0, 1.0)
        check_range("DenseSand", "room", self.room, 1e-9, MAX_VOLUME_CORRECTION)

    @property
    def parameters(self) -> tuple[float, ...]:
        """(mu, lam, critical shear ratio, its excess at the start, dilation, room, bulk modulus / (2 mu))."""
        ratio = shear_ratio(self.friction_angle_deg)
        return (self.mu, self.lam, ratio, shear_ratio(self.peak_angle_deg) - ratio, self.dilation, self.room,
                (self.lam + 2.0 / 3.0 * self.mu) / (2.0 * self.mu))

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template(), dt):
        """Return (h, vc): the deviator scaled onto the surface, the volume grown by dilation; vc [1]: whole growth."""
        dilated = ti.min(vc, p[5])
        trace = h[0] + h[1] + h[2] + (vc - dilated)
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean), h[3], h[4], h[5]]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
        u = [once(d[i] / norm) for i in range(6)]
        det = (u[0] * (u[1] * u[2] - u[5] * u[5]) - u[3] * (u[3] * u[2] - u[5] * u[4])
               + u[4] * (u[3] * u[5] - u[1] * u[4]))
        j = ti.min(ti.max(-2.8284271247 * det, -LARGEST_J3), LARGEST_J3)
        left = 1.0 - dilated / p[5]
        y = p[2] + p[3] * left + 0.0 * norm  # the shear ratio of the present density, from which the root is sought
        k = (9.0 - 3.0 * y * y) / (1.0 - y * y)
        for _ in ti.static(range(4)):  # from simple shear it is reached to single precision below 50 deg
            y = y - (k * j * y * y * y - (k - 3.0) * y * y + k - 9.0) / ((3.0 * k * j * y - 2.0 * (k - 3.0)) * y)
        slope = 1.4142135624 * p[6] * y
        growth = 1.4142135624 * p[4] * left  # per plastic strain
        press = ti.max(-trace, 0.0)
        # the pressure that dilation adds in this substep raises what the surface allows
        allowed = ti.select(press > 0.0, slope * (press + growth * norm) / (1.0 + slope * growth), 0.0 * norm)
        kept = ti.min(allowed, norm)
        scale = kept / norm
        grown = ti.select(press > 0.0, growth * (norm - kept), 0.0 * norm)
        third = (ti.min(trace, 0.0) - grown) / 3.0
        whole = ti.min(dilated + grown + ti.max(trace, 0.0), MAX_VOLUME_CORRECTION)
        return [once(scale * d[i] + (third if ti.static(i < 3) else 0.0)) for i in range(6)], whole


def shear_ratio(angle_deg: float) -> float:
    """Return the ratio of shear stress to pressure in simple shear, from the angle [deg] of triaxial compression."""
    sine = math.sin(math.radians(angle_deg))
    return 2.0 * sine / math.sqrt(3.0 + sine**2)


def critical_angle(ratio: float) -> float:
    """Return the angle [deg] of triaxial compression, from the ratio of shear stress to pressure in simple shear."""
    return math.degrees(math.asin(math.sqrt(3.0) * ratio / math.sqrt(4.0 - ratio**2)))


def dense_sand(relative_density: float, *, E: float, nu: float, density: float,
               critical_angle_deg: float = 33.0) -> DenseSand:
    """Return the sand of a relative density in (0.1, 1], at stresses of some kPa, by Bolton's relations.
    With I = 10 relative_density - 1, at most 4: peak angle 3 I deg above the critical one in triaxial compression, and
    tan(dilatancy angle) with 0.8 of that angle as the excess. His coefficients 3, 0.8 and 4: from memory, to be
    checked; 33 deg is his critical angle of quartz."""
    excess = 3.0 * min(10.0 * relative_density - 1.0, 4.0)
    void = LOOSEST - relative_density * (LOOSEST - DENSEST)
    critical = LOOSEST - 0.1 * (LOOSEST - DENSEST)  # where Bolton's dilatancy index is 0 at 1 kPa
    return DenseSand(E=E, nu=nu, density=density, friction_angle_deg=critical_angle_deg,
                     peak_angle_deg=critical_angle_deg + excess, dilation=math.tan(math.radians(excess / 0.8)),
                     room=math.log((1.0 + critical) / (1.0 + void)))
