"""Initial stress: the stress of a bed at rest, and what particles remember so that they begin under a stress."""

import math

import numpy as np

from mpm.errors import InvalidValue
from mpm.materials.elasticity import Hencky
from mpm.materials.material import Material
from mpm.materials.newtonian_fluid import NewtonianFluid
from mpm.scene.validation import check_finite, read_real

LARGEST_STRAIN = 0.3  # logarithmic strain up to which a stress is accepted, of a fluid loss of volume
COLUMN = 2.0
"""Width of the columns in which a bed's depth is measured, in edges of a particle's cube."""


def geostatic_stress(positions: np.ndarray, volume: float, material: Material, *, gravity: float = 9.81,
                     lateral: float | None = None) -> np.ndarray:
    """Return the stress [Pa] (n, 3, 3) of a bed at rest under gravity [m/s^2] along -z, for `Body(stress=...)`.

    The vertical stress is the weight of the column above, which is taken to be full up to its highest particle.
    volume: of a particle [m^3]. lateral: horizontal stress in the vertical one; None: 1 - sin(friction angle) for a law
    with one (Jaky 1944, J. Soc. Hungarian Architects and Engineers), 1 for a fluid, nu / (1 - nu) for other solids, as
    between sides that do not give way. A bed that begins so need not settle, but for slopes, and for sides that carry a
    part of its weight. Raises InvalidValue."""
    points = read_real("geostatic_stress: positions", positions, "real numbers [m], shape (n, 3)")
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0 or not np.isfinite(points).all():
        raise InvalidValue(f"geostatic_stress: positions have shape {points.shape}; accepted: finite, (n, 3), n >= 1")
    for name, value, least in (("volume", volume, 1e-30), ("gravity", gravity, 0.0), ("lateral", lateral, 0.0)):
        if value is not None and not least <= value < math.inf:
            raise InvalidValue(f"geostatic_stress: {name} = {value}; accepted: a number of {least:g} or more")
    edge = float(volume) ** (1.0 / 3.0)
    _, column = np.unique(np.floor(points[:, :2] / (COLUMN * edge)).astype(np.int64), axis=0, return_inverse=True)
    surface = np.full(column.max() + 1, -np.inf)
    np.maximum.at(surface, column.ravel(), points[:, 2] + 0.5 * edge)
    vertical = -material.density * gravity * (surface[column.ravel()] - points[:, 2])
    share = _lateral(material) if lateral is None else lateral
    return vertical[:, None, None] * np.diag([share, share, 1.0])


def _lateral(material: Material) -> float:
    """Return the horizontal stress of a material at rest, in the vertical one."""
    angle = getattr(material, "friction_angle_deg", None)
    if angle is not None:
        return 1.0 - math.sin(math.radians(angle))
    poisson = material.lam / (2.0 * (material.lam + material.mu))
    return 1.0 if material.state == "volume" else poisson / (1.0 - poisson)


def check_stress(material: Material, stress: np.ndarray, count: int) -> np.ndarray:
    """Return a copy of the stresses of a body; raise InvalidValue for what its law cannot begin under."""
    checked = check_finite("Body: stress", stress, (count, 3, 3))
    if np.abs(checked - checked.transpose(0, 2, 1)).max() > 1e-6 * np.abs(checked).max():
        raise InvalidValue("Body: stress is not symmetric; accepted: stresses [Pa], (n, 3, 3), tension positive")
    name = type(material).__name__
    if isinstance(material, NewtonianFluid):
        deviator = checked - np.trace(checked, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
        if np.abs(deviator).max() > 1e-6 * np.abs(checked).max():
            raise InvalidValue(f"Body: stress of {name} has a deviator; accepted: -pressure times the unit tensor")
        if not material.tension and checked.max() > 0.0:
            raise InvalidValue(f"Body: stress of {name}(tension=False) has a tension of {checked.max():.3g} Pa; "
                               f"accepted: -pressure times the unit tensor, pressure >= 0")
        most = LARGEST_STRAIN * (1.0 - LARGEST_STRAIN) * material.lam
        if checked.min() < -most:
            raise InvalidValue(f"Body: stress of {checked.min():.3g} Pa takes more than {LARGEST_STRAIN:.0%} of the "
                               f"volume of {name}; accepted: down to {-most:.3g} Pa; give a stiffer material")
    elif not isinstance(material, Hencky) or type(material).stress is not Hencky.stress:
        raise InvalidValue(f"Body: stress given for {name}; accepted: for laws with the stress of Hencky's elasticity, "
                           f"and for NewtonianFluid")
    strain = np.abs(checked).max() / (2.0 * material.mu + 3.0 * material.lam)
    if strain > LARGEST_STRAIN:
        raise InvalidValue(f"Body: stress of {np.abs(checked).max():.3g} Pa strains {name} by about {strain:.2g}; "
                           f"accepted: up to {LARGEST_STRAIN}; give a stiffer material, or a stress in Pa")
    return checked


def state_under(material: Material, stress: np.ndarray) -> np.ndarray:
    """Return what particles remember under Kirchhoff's stresses [Pa] (n, 3, 3), which act on their initial volume.
    That is e = b - I, entries xx, yy, zz, xy, xz, yz (n, 6), for a solid, and J - 1 (n, 1) for a fluid at rest."""
    if material.state == "volume":  # its stress is lam (J - 1) J
        return 0.5 * (np.sqrt(1.0 + 4.0 / 3.0 * np.trace(stress, axis1=1, axis2=2) / material.lam) - 1.0)[:, None]
    values, axes = np.linalg.eigh(stress)
    mean = material.lam / (3.0 * material.lam + 2.0 * material.mu) * values.sum(1)[:, None]
    h = (values - mean) / (2.0 * material.mu)
    e = np.einsum("nij,nj,nkj->nik", axes, np.expm1(2.0 * h), axes)
    return e[:, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
