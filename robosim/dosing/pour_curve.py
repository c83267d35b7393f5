"""The pour curve of a tool with a load: mass that has left it over its tilt, at a slow tilt."""

from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from robosim.config.bounds import FilePath, Text
from robosim.config.table import Table

FIRST_SHARE = 0.01
"""Share of the load that has left the tool where pouring begins; single grains roll off earlier."""
CurveTilt = Annotated[float, Field(ge=0.0, le=180.0)]
CurveMass = Annotated[float, Field(ge=0.0, le=10.0)]  # ten times what the largest tool holds


class PourCurve(Table):
    """Mass poured over tilt, both rising, measured with one load of one material; linear between points, else constant.

    It is quasi-static: measured at a tilt so slow that what still falls does not matter."""

    material: FilePath
    """Name of a material of configs/materials, or the path of a .yaml file."""
    load: float = Field(ge=1e-4, le=10.0)
    """Mass in the tool at the start [kg]."""
    rate_deg: float = Field(ge=0.1, le=30.0)
    """Tilt rate of the measurement [deg/s]."""
    tilts_deg: tuple[CurveTilt, ...] = Field(min_length=2, max_length=200)
    """Tilts [deg], rising."""
    masses: tuple[CurveMass, ...] = Field(min_length=2, max_length=200)
    """Mass poured up to each tilt [kg], not falling."""
    source: Text
    """Command that measured it, or where it is from."""

    def check(self) -> None:
        if len(self.tilts_deg) != len(self.masses):
            raise ValueError(f"{len(self.tilts_deg)} tilts_deg and {len(self.masses)} masses; accepted: as many")
        if any(b <= a for a, b in pairwise(self.tilts_deg)):
            raise ValueError(f"tilts_deg {self.tilts_deg}; accepted: rising")
        if any(b < a for a, b in pairwise(self.masses)):
            raise ValueError(f"masses {self.masses}; accepted: none below the one before")
        if self.masses[-1] > 1.001 * self.load:  # masses are rounded to 0.01 g in files
            raise ValueError(f"masses: {self.masses[-1] * 1e3:.2f} g are poured of a load of {self.load * 1e3:.2f} g; "
                             f"accepted: up to the load")
        if self.masses[-1] - self.masses[0] < FIRST_SHARE * self.load:
            raise ValueError(f"masses: {(self.masses[-1] - self.masses[0]) * 1e3:.2f} g are poured in all; accepted: "
                             f"from {FIRST_SHARE * self.load * 1e3:.2f} g, {FIRST_SHARE:.0%} of the load")

    @property
    def begin(self) -> float:
        """Tilt [rad] at which FIRST_SHARE of the load has left the tool."""
        return self.tilt(FIRST_SHARE * self.load)

    @property
    def most(self) -> float:
        """Largest mass [kg] that it reaches."""
        return self.masses[-1]

    def mass(self, tilt: float) -> float:
        """Return the mass poured [kg] up to a tilt [rad]."""
        return float(np.interp(np.degrees(tilt), self.tilts_deg, self.masses))

    def tilt(self, mass: float) -> float:
        """Return the lowest tilt [rad] up to which a mass [kg] is poured; the last one for more than `most`."""
        k = int(np.searchsorted(self.masses, mass))  # the first point that reaches it
        if k in (0, len(self.masses)):
            return float(np.radians(self.tilts_deg[min(k, len(self.masses) - 1)]))
        share = (mass - self.masses[k - 1]) / (self.masses[k] - self.masses[k - 1])
        return float(np.radians(self.tilts_deg[k - 1] + share * (self.tilts_deg[k] - self.tilts_deg[k - 1])))

    def tilt_per_mass(self, poured: float, ahead: float) -> float:
        """Return the mean tilt per mass [rad/kg] from a mass poured [kg] on, over the mass ahead [kg] that follows.
        Beyond the curve's end it is the mean over the last such part of the curve."""
        last = min(poured + ahead, self.most)
        first = max(last - ahead, self.masses[0])
        return (self.tilt(last) - self.tilt(first)) / (last - first)
