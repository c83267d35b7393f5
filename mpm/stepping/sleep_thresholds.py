"""Thresholds of sleep by cell, gravity and stiffness, times one factor."""

import math

import numpy as np

from mpm.scene.scene import Scene

CHECK_CELLS = 3.0  # cells that a pressure wave travels between two sleep checks
CALM_CHECKS = 15  # sleep checks for which a particle is calm before it sleeps
SPEED = 2.5e-3
"""Mean speed up to which a particle is calm, in sqrt(gravity cell): 0.5 mm/s in cells of 4 mm."""
STRAIN = 0.1
"""Change of volume up to which a particle is calm, in that which the weight of one cell's material brings."""
WAKE_DISPLACEMENT = 3.5
"""Displacement of the nodes of a sleeper that wakes it, in that by which the weight of one cell compresses it."""
SUPPORT = 1.0
"""Acceleration, in that of gravity, up to which sleepers support a node that they alone have mass at: less than the
weight of one cell more or less does not disturb them."""
FORCE_BITS, MASS_BITS = 50, 48
"""Bits that sums have for the force of a strain of 1 on a cell, and for the mass of a cell; 12 more are left above."""


def sleep_limits(factor: float, scene: Scene) -> np.ndarray:
    """Return the limits (8,) of `Sleepers` for a scene."""
    grid, bodies, gravity = scene.grid, scene.bodies, scene.gravity
    stiffness = max(body.material.lam + 2.0 * body.material.mu for body in bodies)
    density = max(body.material.density for body in bodies)
    sound = max(math.sqrt((b.material.lam + 2.0 * b.material.mu) / b.material.density) for b in bodies)
    pull = float(np.linalg.norm(gravity))
    interval = CHECK_CELLS * grid.cell / sound
    calm_time = CALM_CHECKS * interval
    speed = factor * SPEED * math.sqrt(pull * grid.cell)
    softest = min(body.material.lam + 2.0 * body.material.mu for body in bodies)
    compression = factor * density * pull * grid.cell / softest
    return np.array([calm_time, speed * calm_time, STRAIN * compression, WAKE_DISPLACEMENT * compression * grid.cell,
                     interval, stiffness * grid.cell**2 * 2.0**-FORCE_BITS, density * grid.cell**3 * 2.0**-MASS_BITS,
                     factor * SUPPORT * pull])
