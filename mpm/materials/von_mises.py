"""Von Mises plasticity: clay, as a return mapping on Hencky strain."""

import math
from dataclasses import dataclass

from mpm.backend import once, ti
from mpm.materials.elasticity import Hencky
from mpm.materials.material import check_range
from mpm.materials.yield_surface import TINY, yielding_share


@dataclass(frozen=True, kw_only=True)
class VonMises(Hencky):
    """Clay: Hencky elasticity up to |dev tau| = sqrt(2/3) yield_stress, then plastic flow at constant volume.
    Raises InvalidValue for a number out of range."""

    yield_stress: float
    """Yield stress [Pa] in uniaxial tension."""

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
    def return_mapping(h: ti.template(), vc: ti.template(), p: ti.template(), dt):  # noqa: ARG004  (of the protocol)
        """Return (h, vc): scale the deviator back onto the cylinder."""
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean)]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (h[3] * h[3] + h[4] * h[4] + h[5] * h[5]) + TINY)
        scale = ti.min(p[2] / norm, 1.0)
        return [once(mean + scale * d[0]), once(mean + scale * d[1]), once(mean + scale * d[2]),
                once(scale * h[3]), once(scale * h[4]), once(scale * h[5])], vc

    @staticmethod
    @ti.func
    def return_mapping_back(h: ti.template(), vc: ti.template(), p: ti.template(), dt,  # noqa: ARG004
                            bar: ti.template(), vc_bar, soft: ti.template()):
        """Return the adjoints of h, vc and p, from those of the mapped h and vc; soft: see `yielding_share`."""
        mean = (h[0] + h[1] + h[2]) / 3.0
        d = [once(h[0] - mean), once(h[1] - mean), once(h[2] - mean), h[3], h[4], h[5]]
        norm = ti.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + 2.0 * (d[3] * d[3] + d[4] * d[4] + d[5] * d[5]) + TINY)
        zero = 0.0 * mean
        scale = ti.min(p[2] / norm, zero + 1.0)
        share = yielding_share(norm, p[2] + zero, soft)
        along = d[0] * bar[0] + d[1] * bar[1] + d[2] * bar[2] + d[3] * bar[3] + d[4] * bar[4] + d[5] * bar[5]
        limit_bar = share * along / norm
        turn = limit_bar * scale / norm
        shape = [once(scale * bar[i] - turn * d[i] * (1.0 if ti.static(i < 3) else 2.0)) for i in range(6)]
        average = (bar[0] + bar[1] + bar[2] - shape[0] - shape[1] - shape[2]) / 3.0
        state = [once(shape[i] + (average if ti.static(i < 3) else 0.0)) for i in range(6)]
        return state, vc_bar, [zero, zero, limit_bar]
