"""Small holes in shells: openings below the size of a cell, through which Beverloo's law lets grains pass."""

import math
from dataclasses import dataclass

import numpy as np

from mpm.errors import InvalidValue
from mpm.scene.validation import check_finite, read_real

PACKING = 0.6
"""Share of a poured bed's volume that its grains fill [-]; assumed: 0.55 to 0.64 for grains of one size."""
AVALANCHE, AVALANCHE_EXPONENT = 9900.0, 6.9
"""Mean number of grains that leave a silo before it jams: AVALANCHE / (jam ratio - D / d)^AVALANCHE_EXPONENT; Zuriguel
et al. 2005, Phys. Rev. E 71, 051303: 9900 +- 100 and 6.9 +- 0.2 for spheres."""
EDGE = 1e-6
"""Smallest distance of D / d from the jam ratio that differs from none."""


@dataclass(frozen=True, eq=False)
class Orifice:
    """Equal round holes in a `Shell`, too small for the cells: grains leave through them by Beverloo's law.

    As long as grains cover a hole from inside, and what they feel there, gravity less the shell's acceleration, has a
    component g outward along the hole's axis, it passes C rho sqrt(g) (D - k d)^(5/2) [kg/s], rho being the density of
    their `Body`. A hole with D / d below `blocked_ratio` passes nothing. Between that and `jam_ratio` it jams after an
    avalanche of AVALANCHE / (jam_ratio - D / d)^6.9 grains, always the mean; it opens when the shell vibrates with an
    amplitude a and angular frequency w of a w^2 >= `vibration` times gravity, and when it is not loaded any more.

    Source: Beverloo, Leniger & van de Velde 1961, Chem. Eng. Sci. 15:260. Raises InvalidValue for shapes that do not
    match and numbers out of range."""

    positions: np.ndarray
    """Centres of the holes [m] (n, 3) on the mid-surface, in the collider's frame."""
    axes: np.ndarray
    """Direction (n, 3), or one (3,) for all, in which each hole lets grains out; normalised."""
    diameter: float
    """Diameter D of each hole [m]."""
    grain_diameter: float
    """Diameter d of the grains [m]."""
    k: float = 1.4
    """Grain diameters by which the opening is effectively smaller [-]; 1.3 to 2.9 by grain, 1.4 for spheres."""
    C: float = 0.58
    """Discharge coefficient [-]; 0.55 to 0.65 (Mankoc et al. 2007, arXiv 0707.4550)."""
    jam_ratio: float = 4.94
    """D / d from which a hole never jams [-]; Zuriguel et al. 2005: 4.94 +- 0.03 for spheres, 6.0 for rice."""
    blocked_ratio: float = 4.0
    """D / d below which nothing passes, with or without vibration [-]; assumed: avalanches are too short below."""
    vibration: float = 1.0
    """Peak acceleration of the shell over gravity that keeps a hole from jamming [-]; assumed: grains lose contact
    there."""

    def __post_init__(self) -> None:
        positions = np.atleast_2d(read_real("Orifice: positions", self.positions, "finite numbers, shape (n, 3)"))
        check_finite("Orifice: positions", positions, (max(len(positions), 1), 3))
        axes = read_real("Orifice: axes", self.axes, "finite numbers, shape (n, 3) or (3,)")
        axes = check_finite("Orifice: axes", np.tile(axes, (len(positions), 1)) if axes.ndim == 1 else axes,
                            positions.shape)
        lengths = np.linalg.norm(axes, axis=1)
        if not lengths.all():
            raise InvalidValue(f"Orifice: axes[{int(np.argmin(lengths))}] has no length; accepted: a direction")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "axes", axes / lengths[:, None])
        for name in ("diameter", "grain_diameter", "C"):
            if not 0 < getattr(self, name) < math.inf:
                raise InvalidValue(f"Orifice: {name} = {getattr(self, name)}; accepted: a positive number")
        for name in ("k", "jam_ratio", "blocked_ratio", "vibration"):
            if not 0 <= getattr(self, name) < math.inf:
                raise InvalidValue(f"Orifice: {name} = {getattr(self, name)}; accepted: 0 or more")

    @property
    def ratio(self) -> float:
        """D / d [-]."""
        return self.diameter / self.grain_diameter

    @property
    def opening(self) -> float:
        """Effective diameter D - k d [m]; 0 where the hole is blocked."""
        return 0.0 if self.ratio < self.blocked_ratio else max(self.diameter - self.k * self.grain_diameter, 0.0)

    @property
    def avalanche(self) -> float:
        """Bulk volume [m^3] that passes before the hole jams; infinite from the jam ratio on."""
        missing = self.jam_ratio - self.ratio
        if missing < EDGE:
            return math.inf
        return AVALANCHE / missing**AVALANCHE_EXPONENT * math.pi / 6.0 * self.grain_diameter**3 / PACKING

    def rate(self, density: float, gravity: float = 9.81) -> float:
        """Return the mass [kg/s] that one hole passes while it is covered and not jammed.
        density: bulk density [kg/m^3]. gravity: component along the hole's axis [m/s^2]."""
        return self.C * density * math.sqrt(max(gravity, 0.0)) * self.opening**2.5
