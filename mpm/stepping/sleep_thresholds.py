"""When particles fall asleep and wake: thresholds from cell, gravity and stiffness, times one knob."""

import math
from collections.abc import Sequence

import numpy as np

from mpm.errors import InvalidValue
from mpm.scene.body import Body
from mpm.scene.grid import Grid

LARGEST = 100.0
"""Largest accepted value of `Solver(sleep=)`."""
LOOK_CELLS = 3.0
"""Cells that a pressure wave travels between two looks at who falls asleep or wakes."""
CALM_LOOKS = 15
"""Looks for which a particle is calm before it sleeps."""
SPEED = 2.5e-3
"""Mean speed up to which a particle is calm, in sqrt(gravity cell): 0.5 mm/s in cells of 4 mm."""
STRAIN = 0.1
"""Change of volume up to which a particle is calm, in that which the weight of one cell's material brings."""
PUSH = 3.5
"""Displacement of the nodes of a sleeper that wakes it, in that by which the weight of one cell compresses it."""
HOLD = 1.0
"""Acceleration, in that of gravity, up to which sleepers hold a node that they alone have mass at: less than the weight
of one cell more or less does not stir what lies still."""
FORCE_BITS, MASS_BITS = 50, 48
"""Bits that sums have for the force of a strain of 1 on a cell, and for the mass of a cell; 12 more are left above."""


def read_sleep(sleep: bool | float) -> float:
    """Return the accuracy knob, 0 for no sleeping; raises InvalidValue for what is no such number."""
    if isinstance(sleep, bool | np.bool_):
        return float(sleep)
    if not isinstance(sleep, int | float | np.number) or not 0 < sleep <= LARGEST:
        raise InvalidValue(f"Solver: sleep = {sleep!r}; accepted: False, True (1), or a factor on its thresholds, "
                           f"above 0, at most {LARGEST:g}")
    return float(sleep)


def sleep_limits(knob: float, grid: Grid, bodies: Sequence[Body], gravity: np.ndarray) -> np.ndarray:
    """Return the limits (8,) of `Sleepers` for a scene."""
    stiffness = max(body.material.lam + 2.0 * body.material.mu for body in bodies)
    density = max(body.material.density for body in bodies)
    sound = max(math.sqrt((b.material.lam + 2.0 * b.material.mu) / b.material.density) for b in bodies)
    pull = float(np.linalg.norm(gravity))
    look = LOOK_CELLS * grid.cell / sound
    calm_time = CALM_LOOKS * look
    speed = knob * SPEED * math.sqrt(pull * grid.cell)
    softest = min(body.material.lam + 2.0 * body.material.mu for body in bodies)
    compression = knob * density * pull * grid.cell / softest
    return np.array([calm_time, speed * calm_time, STRAIN * compression, PUSH * compression * grid.cell, look,
                     stiffness * grid.cell**2 * 2.0**-FORCE_BITS, density * grid.cell**3 * 2.0**-MASS_BITS,
                     knob * HOLD * pull])
