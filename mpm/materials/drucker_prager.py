"""Drucker-Prager plasticity: sand, as a return mapping on Hencky strain."""

import math
from dataclasses import dataclass

from mpm.backend import once, ti
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.elasticity import Hencky
from mpm.materials.material import check_range
from mpm.materials.yield_surface import TINY, yielding_share

CONES = ("compression", "plane_strain")
MAX_VOLUME_CORRECTION = 0.5
"""Largest logarithmic expansion that a particle remembers, to recover it when it is compressed again."""


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Hencky):
    """Sand: Hencky elasticity inside a Drucker-Prager cone (Klar et al. 2016, ACM TOG 35(4):103), with the volume
    correction of Tampubolon et al. 2017 (TOG 36(4):105): stress-free expansion is reversed before pressure builds up.

    Raises InvalidValue for numbers out of range, UnknownName for another cone.
    """

    friction_angle_deg: float
    """Internal friction angle [deg], in [0, 90)."""
    cohesion: float = 0.0
    """Shear strength [Pa] at zero pressure; tension is carried up to cohesion / tan(friction angle)."""
    cone: str = "compression"
    """Match with Mohr-Coulomb: "compression", in triaxial compression (Klar et al. 2016), or "plane_strain"."""

    plastic = True
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
        """Return (h, vc): scale the deviator onto the cone at constant volume, or drop it at the apex."""
        trace = h[0] + h[1] + h[2] + vc
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean)]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5]) + TINY)
        allowed = ti.max(p[2] * (p[3] - trace), 0.0)
        scale = ti.min(allowed / norm, 1.0)
        kept = ti.min(trace, p[3])
        third = kept / 3.0
        expansion = ti.min(trace - kept, MAX_VOLUME_CORRECTION)
        return [once(third + scale * d[0]), once(third + scale * d[1]), once(third + scale * d[2]),
                once(scale * h[3]), once(scale * h[4]), once(scale * h[5])], expansion

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), bar: ti.template(), vc_bar,
                            soft: ti.template()):
        """Return the adjoints of h, vc and p, from those of the mapped h and vc; soft: see `yielding_share`."""
        trace = h[0] + h[1] + h[2] + vc
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean), h[3], h[4], h[5]]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
        zero = 0.0 * trace
        allowed = ti.max(p[2] * (p[3] - trace), 0.0)
        yields, whole = allowed < norm, trace < p[3]
        share = yielding_share(norm, allowed, soft)
        scale = ti.select(yields, allowed / norm, zero + 1.0)
        along = d[0] * bar[0] + d[1] * bar[1] + d[2] * bar[2] + d[3] * bar[3] + d[4] * bar[4] + d[5] * bar[5]
        allowed_bar = share * along / norm
        held = ti.select(p[2] * (p[3] - trace) > 0.0, allowed_bar, zero)
        kept_bar = (bar[0] + bar[1] + bar[2]) / 3.0
        free = ti.select(trace - ti.min(trace, p[3]) < MAX_VOLUME_CORRECTION, vc_bar, zero)
        # the expansion is trace - kept: nothing of it where all is kept
        trace_bar = ti.select(whole, kept_bar, free) - p[2] * held
        turn = allowed_bar * scale / norm
        shape = [once(scale * bar[i] - turn * d[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        average = (shape[0] + shape[1] + shape[2]) / 3.0
        state = [once(shape[i] + (trace_bar - average if ti.static(i < 3) else 0.0)) for i in range(6)]
        apex_bar = ti.select(whole, zero, kept_bar - free) + p[2] * held
        return state, trace_bar, [zero, zero, (p[3] - trace) * held, apex_bar]
