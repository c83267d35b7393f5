"""Colours of grains by what they are or do."""

from typing import Literal, get_args

import matplotlib
import numpy as np

from robosim.recordings.frames import PRESSURES, SPEEDS, GrainState

Colouring = Literal["material", "speed", "pressure", "awake", "outside"]
COLOURINGS: tuple[Colouring, ...] = get_args(Colouring)
LEGENDS: dict[str, str] = {
    "material": "", "speed": "speed: dark 1 mm/s, bright 1 m/s", "pressure": "pressure: dark 10 Pa, bright 100 kPa",
    "awake": "blue: asleep, not computed", "outside": "red: outside of tool and places",
}
"""Colouring -> what its colours mean."""
SPEED_RANGE, PRESSURE_RANGE = (SPEEDS[0], 1.0), (10.0, PRESSURES[1] / 10.0)
"""Values of the darkest and the brightest colour [m/s], [Pa]."""
ASLEEP, OUTSIDE = (64, 97, 158), (214, 48, 32)
"""RGB of grains that sleep, and of those outside of all places."""
SHADES = 0.16
"""Half range of the brightness of grains of one material: without it a heap has no surface."""


class GrainColours:
    """Colours of n grains; material: RGB, 0 to 1."""

    def __init__(self, n: int, material: tuple[float, float, float]) -> None:
        shades = np.random.default_rng(0).uniform(1.0 - 2.0 * SHADES, 1.0, (n, 1))
        self._material = np.clip(255.0 * shades * np.asarray(material), 0.0, 255.0).astype(np.uint8)
        self._tables = {colouring: (255 * matplotlib.colormaps[name](np.linspace(0, 1, 256))[:, :3]).astype(np.uint8)
                        for colouring, name in (("speed", "viridis"), ("pressure", "inferno"))}

    def colours(self, grains: GrainState, colouring: str, placed: np.ndarray | None = None) -> np.ndarray:
        """Return colours (n, 3), uint8; placed (n,): which grains are in the tool or a place."""
        if colouring in ("speed", "pressure"):  # on a logarithmic scale
            values, (low, high) = (grains.speeds, SPEED_RANGE) if colouring == "speed" else \
                (grains.pressures, PRESSURE_RANGE)
            share = np.log(np.clip(values, low, high) / low) / np.log(high / low)
            return self._tables[colouring][(255 * share).astype(np.uint8)]
        marked = {"awake": (~grains.awake, ASLEEP), "outside": (None if placed is None else ~placed, OUTSIDE)}
        chosen, colour = marked.get(colouring, (None, ASLEEP))
        if chosen is None or not chosen.any():
            return self._material
        result = self._material.copy()
        result[chosen] = colour
        return result
