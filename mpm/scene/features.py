"""What a scene has. Kernels read these inside `ti.static` only: what is absent is not compiled."""

from dataclasses import dataclass

from mpm.geometry.shell import Shell
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.walls import Walls


@dataclass(frozen=True)
class Features:
    """Derived from the scene when the solver is built."""

    precision: str
    """"f32" or "f64"."""
    integrator: str
    """"series", "exact" or "auto": how strain is taken from and put back into b."""
    volume_correction: bool
    """Some material remembers expansion."""
    tensor_state: bool
    """Some material remembers b."""
    volume_state: bool
    """Some material remembers J."""
    body_acceleration: bool
    """Every grain has an acceleration of its own besides gravity."""
    periodic: tuple[bool, bool, bool]
    """Axes along which space closes on itself."""
    moving_solids: tuple[int, ...]
    """Solid colliders that are given a motion."""
    strides: bool
    """Velocities may stay on the grid over several substeps."""
    shells: tuple[int, ...]
    """Thin colliders, with grains on both sides; they may move."""
    mobile: tuple[int, ...]
    """Moving colliders that contact moves too; their motion is solved for in the launch."""
    static_colliders: tuple[int, ...]
    """Colliders that never move: their contact is looked up once per node."""

    @property
    def moving_colliders(self) -> tuple[int, ...]:
        """Colliders that are given a motion, in the order of the motion table's rows."""
        return self.moving_solids + self.shells

    @property
    def shell_rows(self) -> tuple[tuple[int, int], ...]:
        """(row of the motion table, index of the collider) of every shell."""
        return tuple((len(self.moving_solids) + i, index) for i, index in enumerate(self.shells))

    @property
    def mobile_rows(self) -> tuple[tuple[int, int], ...]:
        """(place among the mobile colliders, row of the motion table) of each of them."""
        return tuple((b, self.moving_colliders.index(index)) for b, index in enumerate(self.mobile))


def features_of(bodies: list[Body], colliders: list[Collider], walls: Walls, precision: str, integrator: str,
                body_acceleration: bool, strides: bool) -> Features:
    """What a scene has."""
    thin = [isinstance(c.sdf, Shell) for c in colliders]
    return Features(
        precision=precision, integrator=integrator,
        volume_correction=any(b.material.has_volume_correction for b in bodies),
        tensor_state=any(b.material.state != "volume" for b in bodies),
        volume_state=any(b.material.state == "volume" for b in bodies),
        body_acceleration=body_acceleration, strides=strides, periodic=walls.periodic,
        moving_solids=tuple(i for i, c in enumerate(colliders) if not c.static and not thin[i]),
        shells=tuple(i for i in range(len(colliders)) if thin[i]),
        mobile=tuple(i for i, c in enumerate(colliders) if c.mobile),
        static_colliders=tuple(i for i, c in enumerate(colliders) if c.static and not thin[i]),
    )
