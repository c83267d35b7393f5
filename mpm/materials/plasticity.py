"""Plastic laws: return mappings on Hencky strain."""

import math
from dataclasses import dataclass

from mpm.backend import ti
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.elasticity import Hencky, check_range
from mpm.materials.hencky_strain import keep

CONES = ("compression", "plane_strain")
TINY = 1e-30
"""Guards 0/0 where a deviator vanishes; below the square of any strain that single precision can hold."""
MAX_VOLUME_CORRECTION = 0.5
"""Largest logarithmic expansion that a grain remembers and takes back when it is compressed again."""


@ti.func
def share_that_yields(norm, allowed, soft: ti.template()):
    """1 where a strain deviator is larger than allowed, else 0; with soft > 0 a smooth step of that relative width, so
    that derivatives do not jump from grain to grain (they are then no longer those of the motion)."""
    if ti.static(soft > 0):
        beyond = (norm / (allowed + TINY) - 1.0) / soft
        return 1.0 / (1.0 + ti.exp(-ti.min(ti.max(beyond, -30.0), 30.0)))
    else:
        return ti.select(allowed < norm, 0.0 * norm + 1.0, 0.0 * norm)


@dataclass(frozen=True, kw_only=True)
class DruckerPrager(Hencky):
    """Sand: Hencky elasticity inside a Drucker-Prager cone (Klar et al. 2016, ACM TOG 35(4):103), with the volume
    correction of Tampubolon et al. 2017 (TOG 36(4):105): expansion without stress is taken back before stress returns.

    friction_angle_deg: internal friction angle, [0, 90). cohesion [Pa]: shear strength without pressure; tension is
    carried up to cohesion / tan(friction angle) and cut off there. cone: "compression" matches Mohr-Coulomb in
    triaxial compression as Klar does, "plane_strain" matches it in plane strain.
    """

    friction_angle_deg: float
    cohesion: float = 0.0
    cone: str = "compression"

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

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), bar: ti.template(), vc_bar,
                            soft: ti.template()):
        """Bars of h, vc and the numbers p by those of what `return_mapping` gives; soft: see `share_that_yields`."""
        trace = h[0] + h[1] + h[2] + vc
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [keep(h[0] - mean), keep(h[1] - mean), keep(h[2] - mean), h[3], h[4], h[5]]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
        zero = 0.0 * trace
        allowed = ti.max(p[2] * (p[3] - trace), 0.0)
        yields, whole = allowed < norm, trace < p[3]
        share = share_that_yields(norm, allowed, soft)
        scale = ti.select(yields, allowed / norm, zero + 1.0)
        along = d[0] * bar[0] + d[1] * bar[1] + d[2] * bar[2] + d[3] * bar[3] + d[4] * bar[4] + d[5] * bar[5]
        allowed_bar = share * along / norm
        held = ti.select(p[2] * (p[3] - trace) > 0.0, allowed_bar, zero)
        kept_bar = (bar[0] + bar[1] + bar[2]) / 3.0
        free = ti.select(trace - ti.min(trace, p[3]) < MAX_VOLUME_CORRECTION, vc_bar, zero)
        # the expansion is trace - kept: nothing of it where all is kept
        trace_bar = ti.select(whole, kept_bar, free) - p[2] * held
        turn = allowed_bar * scale / norm
        shape = [keep(scale * bar[i] - turn * d[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        average = (shape[0] + shape[1] + shape[2]) / 3.0
        state = [keep(shape[i] + (trace_bar - average if ti.static(i < 3) else 0.0)) for i in range(6)]
        apex_bar = ti.select(whole, zero, kept_bar - free) + p[2] * held
        return state, trace_bar, [zero, zero, (p[3] - trace) * held, apex_bar]


@dataclass(frozen=True, kw_only=True)
class VonMises(Hencky):
    """Clay: Hencky elasticity up to |dev tau| = sqrt(2/3) yield_stress, then flow at constant volume.

    yield_stress [Pa]: strength in uniaxial tension.
    """

    yield_stress: float

    plastic = True

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("VonMises", "yield_stress [Pa]", self.yield_stress, 0.0, math.inf)

    @property
    def parameters(self) -> tuple[float, ...]:
        """(mu, lam, largest norm of the strain deviator)."""
        return (self.mu, self.lam, math.sqrt(2.0 / 3.0) * self.yield_stress / (2.0 * self.mu))

    @staticmethod
    @ti.func
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template()):
        """Scale the deviator back onto the cylinder."""
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [keep(h[0] - mean), keep(h[1] - mean), keep(h[2] - mean)]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5]) + TINY)
        scale = ti.min(p[2] / norm, 1.0)
        return [keep(mean + scale * d[0]), keep(mean + scale * d[1]), keep(mean + scale * d[2]),
                keep(scale * h[3]), keep(scale * h[4]), keep(scale * h[5])], vc

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), bar: ti.template(), vc_bar,
                            soft: ti.template()):
        """Bars of h, vc and the numbers p by those of what `return_mapping` gives; soft: see `share_that_yields`."""
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [keep(h[0] - mean), keep(h[1] - mean), keep(h[2] - mean), h[3], h[4], h[5]]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
                       + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
        zero = 0.0 * mean
        scale = ti.min(p[2] / norm, zero + 1.0)
        share = share_that_yields(norm, p[2] + zero, soft)
        along = d[0] * bar[0] + d[1] * bar[1] + d[2] * bar[2] + d[3] * bar[3] + d[4] * bar[4] + d[5] * bar[5]
        limit_bar = share * along / norm
        turn = limit_bar * scale / norm
        shape = [keep(scale * bar[i] - turn * d[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        average = (bar[0] + bar[1] + bar[2] - shape[0] - shape[1] - shape[2]) / 3.0
        state = [keep(shape[i] + (average if ti.static(i < 3) else 0.0)) for i in range(6)]
        return state, vc_bar, [zero, zero, limit_bar]
