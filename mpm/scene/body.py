"""Bodies: particles of one material."""

from dataclasses import dataclass

import numpy as np

from mpm.errors import InvalidValue
from mpm.materials.material import Material, check_material
from mpm.scene.initial_stress import check_stress
from mpm.scene.validation import check_finite, read_real, with_values


@dataclass(frozen=True, eq=False)
class Body:
    """Particles of one material; raises InvalidValue for arrays of wrong shape or an incomplete law."""

    material: Material
    """Material of the particles, such as `mpm.DruckerPrager`."""
    positions: np.ndarray
    """Positions [m], shape (n, 3)."""
    velocities: np.ndarray | None = None
    """Velocities [m/s], shape (n, 3); None: at rest."""
    volume: float | np.ndarray | None = None
    """Volume of each particle [m^3], a number or shape (n,); required."""
    stress: np.ndarray | None = None
    """Stress [Pa] at the begin, shape (n, 3, 3), tension positive, such as `mpm.geostatic_stress` gives; None: none.
    It acts on `volume`, as Kirchhoff's does: particles that fill a bed are in balance with its weight where they lie.
    What a plastic law does not carry yields in the first substep."""

    def __post_init__(self) -> None:
        check_material(self.material)
        positions = read_real("Body: positions", self.positions, "real numbers [m], shape (n, 3)")
        if positions.ndim != 2 or positions.shape[1] != 3 or len(positions) == 0:
            raise InvalidValue(f"Body: positions have shape {positions.shape}; accepted: (n, 3) with n >= 1")
        if not np.isfinite(positions).all():
            raise InvalidValue("Body: positions hold non-finite numbers")
        volume = read_real("Body: volume", self.volume, "the positive volume of a particle [m^3]")
        if not np.all((volume > 0) & (volume < np.inf)):
            raise InvalidValue(f"Body: volume = {self.volume}; accepted: the positive volume of a particle [m^3]")
        if np.size(self.volume) not in (1, len(positions)):
            raise InvalidValue(f"Body: volume has shape {np.shape(self.volume)}; accepted: () or ({len(positions)},)")
        if self.velocities is not None:
            check_finite("Body: velocities", self.velocities, positions.shape)
        if self.stress is not None:
            check_stress(self.material, self.stress, len(positions))


def with_volume(body: Body, volume: float) -> Body:
    """Return a body with particles of another volume [m^3]; raise InvalidValue for one with several volumes."""
    if np.size(body.volume) != 1:
        raise InvalidValue("set_volume: the body's particles have volumes of their own; accepted: one with one volume")
    if not 0.0 < volume < np.inf:
        raise InvalidValue(f"set_volume: volume = {volume}; accepted: the positive volume of a particle [m^3]")
    return with_values(body, volume=float(volume))


def largest_volume(bodies: list[Body]) -> float:
    """Return the volume [m^3] of the largest particle of some bodies."""
    return max(float(np.max(body.volume)) for body in bodies)


def half_edge(volume: float) -> float:
    """Return half the edge [m] of a particle's cube."""
    return 0.5 * float(np.cbrt(volume))
