"""What a scene has. Kernels read features inside `ti.static` only: what is absent is not compiled."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mpm.backend import PRECISIONS, is_concurrent, is_shared, session_precision
from mpm.errors import InvalidValue, UnknownName
from mpm.materials.hencky_strain import INTEGRATORS
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid
from mpm.scene.validation import describe
from mpm.scene.walls import Walls

Contact = Literal["near", "touching"]
CONTACTS = ("near", "touching")
"""What nodes a solid stops: all that are near it, or those whose material touches one of its faces."""


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
    touching: bool
    """Solids stop only material that touches one of their faces."""
    orifices: tuple[tuple[int, int], ...]
    """Index of a shell with small holes, and how many it has."""
    cell_rates: bool
    """The volume of fluids changes by the mean rate of a cell."""

    serial: bool
    """Whether one thread advances the scene; otherwise several threads or a GPU."""

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


def check_scene(grid: Grid, bodies: list[Body], colliders: list[Collider] | None, walls: Walls | None) -> None:
    """Raise InvalidValue for arguments of `Solver` of other types, and for particles outside the grid."""
    for name, given, accepted, kind in (("grid", grid, "mpm.Grid(lower, upper, cell)", Grid),
                                        ("walls", walls, 'mpm.Walls, such as mpm.Walls.all("slip"), or None', Walls)):
        if not isinstance(given, kind) and not (name == "walls" and given is None):
            raise InvalidValue(f"Solver: {name} = {describe(given)}; accepted: {accepted}")
    _check_list("bodies", bodies, Body)
    check_colliders(colliders or [])
    for body in bodies:
        grid.check_inside(np.asarray(body.positions, float))


def check_colliders(colliders: list[Collider]) -> None:
    """Raise InvalidValue for anything but a list of colliders."""
    _check_list("colliders", colliders, Collider)


def _check_list(name: str, given: object, kind: type) -> None:
    """Raise InvalidValue for anything but a list of a kind."""
    if not isinstance(given, list | tuple):
        raise InvalidValue(f"Solver: {name} = {describe(given)}; accepted: a list of mpm.{kind.__name__}")
    for place, one in enumerate(given):
        if not isinstance(one, kind):
            raise InvalidValue(f"Solver: {name}[{place}] = {describe(one)}; accepted: mpm.{kind.__name__}")


def choose_numerics(bodies: list[Body], precision: str | None, integrator: str | None) -> tuple[str, str]:
    """Return precision and integrator of a scene, see `Solver`; raises UnknownName, and InvalidValue without a body."""
    session = session_precision()  # starts the backend, whatever precision is given
    chosen = precision or session
    if chosen not in PRECISIONS:
        raise UnknownName("precision", precision, PRECISIONS)
    if not bodies:
        raise InvalidValue("Solver: bodies is empty; give at least one Body")
    takes_logarithms = any(body.material.state == "hencky" for body in bodies)
    integrates = integrator or ("auto" if chosen == "f32" and takes_logarithms else "exact")
    if integrates not in INTEGRATORS:
        raise UnknownName("integrator", integrator, INTEGRATORS)
    return chosen, integrates


def features_of(bodies: list[Body], colliders: list[Collider], walls: Walls, precision: str, integrator: str,
                body_acceleration: bool, strides: bool, sleep: bool = False, contact: Contact = "near") -> Features:
    """Derive the features of a scene.

    Raises InvalidValue for a scene with sleeping on a GPU, and with body accelerations; for one with orifices on a
    GPU, and with a fluid; for fluids of several `volume_rate`, and with sleeping for one of "cell"; UnknownName for a
    contact that is not in CONTACTS.
    """
    if contact not in CONTACTS:
        raise UnknownName("contact", contact, CONTACTS)
    thin = [c.sdf.is_thin for c in colliders]
    mobile, periodic = tuple(i for i, c in enumerate(colliders) if c.mobile), walls.periodic
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
    return Features(
        precision=precision, integrator=integrator,
        volume_correction=any(b.material.has_volume_correction for b in bodies),
        tensor_state=any(b.material.state != "volume" for b in bodies),
        volume_state=any(b.material.state == "volume" for b in bodies),
        body_acceleration=body_acceleration, strides=strides, periodic=periodic,
        serial=not is_concurrent(),
        moving_solids=tuple(i for i, c in enumerate(colliders) if not c.static and not thin[i]),
        shells=tuple(i for i in range(len(colliders)) if thin[i]),
        mobile=mobile,
        static_colliders=tuple(i for i, c in enumerate(colliders) if c.static and not thin[i]),
        sleep=sleep, touching=contact == "touching" and any(not t for t in thin),
        orifices=orifices, cell_rates=_has_cell_rates(bodies, sleep),
    )


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
