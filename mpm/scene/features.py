"""Features of a scene. Kernels read them inside `ti.static` only: code for absent ones is not compiled."""

from dataclasses import dataclass

import numpy as np

from mpm.backend import is_concurrent, is_shared
from mpm.errors import InvalidValue
from mpm.materials.material import stiffens_with_density
from mpm.scene.body import Body
from mpm.scene.scene import Numerics, Scene


@dataclass(frozen=True)
class Features:
    """Properties of a scene that determine which kernels are compiled; derived from the scene."""

    precision: str
    """"f32" or "f64"."""
    integrator: str
    """"series", "exact" or "auto": how Hencky strain is computed from b, and b from it."""
    volume_correction: bool
    """A law has a volume correction."""
    tensor_state: bool
    """Particles of a law store e = b - I."""
    volume_state: bool
    """Particles of a law store J - 1."""
    density_state: bool
    """Particles of a law are as stiff as the material around them is dense."""
    body_acceleration: bool
    """Every particle has an acceleration of its own besides gravity."""
    periodic: tuple[bool, bool, bool]
    """Whether each axis is periodic."""
    moving_solids: tuple[int, ...]
    """Indices of solid colliders that move."""
    strides: bool
    """Velocities may stay on the grid over several substeps."""
    shells: tuple[int, ...]
    """Indices of thin shells; they may move."""
    mobile: tuple[int, ...]
    """Indices of mobile colliders: contact moves them."""
    static_colliders: tuple[int, ...]
    """Indices of static colliders."""
    sleep: bool
    """Particles at rest fall asleep."""
    orifices: tuple[tuple[int, int], ...]
    """Index of a shell with small holes, and how many it has."""
    cell_rates: bool
    """The volume of fluids changes by the mean rate of a cell."""

    serial: bool
    """Whether one thread advances the scene; otherwise several threads or a GPU."""

    @property
    def static_row(self) -> int:
        """Row of the static solids in tables with one for every solid that moves."""
        return len(self.moving_solids)

    @property
    def solids(self) -> int:
        """Number of solids that move, and one more where some are static."""
        return len(self.moving_solids) + bool(self.static_colliders)

    @property
    def moving_colliders(self) -> tuple[int, ...]:
        """Colliders that are given a motion, in the order of the motion table's rows."""
        return self.moving_solids + self.shells

    @property
    def shell_rows(self) -> tuple[tuple[int, int], ...]:
        """(row of the motion table, index of the collider) of every shell."""
        return tuple((len(self.moving_solids) + i, index) for i, index in enumerate(self.shells))

    @property
    def orifice_rows(self) -> tuple[tuple[int, int, int, int], ...]:
        """(row of the motion table, index of the collider, first and last + 1 hole) of every shell with holes."""
        ends = np.cumsum([n for _, n in self.orifices]).tolist()
        return tuple((self.moving_colliders.index(index), index, end - n, end)
                     for (index, n), end in zip(self.orifices, ends))

    @property
    def mobile_rows(self) -> tuple[tuple[int, int], ...]:
        """(place among the mobile colliders, row of the motion table) of each of them."""
        return tuple((b, self.moving_colliders.index(index)) for b, index in enumerate(self.mobile))


def features_of(scene: Scene, numerics: Numerics, *, strides: bool = True, body_acceleration: bool = False) -> Features:
    """Derive the features of a scene.
    numerics: with precision and integrator chosen. Raises InvalidValue for a scene with sleeping on a GPU, and with
    body accelerations; for one with orifices on a GPU, and with a fluid; for fluids of several `volume_rate`, and with
    sleeping for one of "cell"."""
    bodies, colliders, sleep = scene.bodies, scene.colliders, bool(numerics.sleep)
    thin = [c.sdf.is_thin for c in colliders]
    mobile, periodic = tuple(i for i, c in enumerate(colliders) if c.mobile), scene.walls.periodic
    if sleep and is_shared():
        raise InvalidValue("Solver: sleep on a GPU; accepted there: sleep=False, or mpm.init(arch=\"cpu\")")
    if sleep and body_acceleration:
        raise InvalidValue("Solver: sleep with body_acceleration; accepted: sleep=False, or gravity alone")
    orifices = tuple((i, sum(len(o.positions) for o in c.orifices)) for i, c in enumerate(colliders) if c.orifices)
    if orifices and is_shared():
        raise InvalidValue(f"Solver: collider {orifices[0][0]} has orifices, which no kernel of a GPU has; accepted "
                           "there: shells without, or mpm.init(arch=\"cpu\")")
    for place, body in enumerate(bodies):
        if orifices and body.material.state == "volume":
            raise InvalidValue(f"Solver: collider {orifices[0][0]} has orifices, and bodies[{place}] is a fluid, which "
                               "does not flow by Beverloo's law; accepted: granular materials")
    return Features(precision=numerics.precision or "", integrator=numerics.integrator or "",
                    volume_correction=any(b.material.has_volume_correction for b in bodies),
                    tensor_state=any(b.material.state != "volume" for b in bodies),
                    volume_state=any(b.material.state == "volume" for b in bodies),
                    density_state=any(stiffens_with_density(b.material) for b in bodies),
                    body_acceleration=body_acceleration, strides=strides, periodic=periodic, serial=not is_concurrent(),
                    moving_solids=tuple(i for i, c in enumerate(colliders) if not c.static and not thin[i]),
                    shells=tuple(i for i in range(len(colliders)) if thin[i]), mobile=mobile,
                    static_colliders=tuple(i for i, c in enumerate(colliders) if c.static and not thin[i]), sleep=sleep,
                    orifices=orifices, cell_rates=_has_cell_rates(bodies, sleep))


def _has_cell_rates(bodies: list[Body], sleep: bool) -> bool:
    """Return whether the fluids' volume changes by the mean rate of a cell; raises InvalidValue, see `features_of`."""
    rates = {place: getattr(body.material, "volume_rate", "particle") for place, body in enumerate(bodies)
             if body.material.state == "volume"}
    for place, rate in rates.items():
        if rate != next(iter(rates.values())):
            raise InvalidValue(f"Solver: bodies[{place}] is a fluid with volume_rate = {rate!r}, and bodies"
                               f"[{next(iter(rates))}] one with {next(iter(rates.values()))!r}; accepted: the same for "
                               "all fluids of a scene")
        if rate == "cell" and sleep:
            raise InvalidValue(f"Solver: sleep, and bodies[{place}] is a fluid with volume_rate = 'cell'; accepted: "
                               "sleep=False, or volume_rate='particle'")
    return "cell" in rates.values()
