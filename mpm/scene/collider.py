"""Colliders: rigid bodies in contact with particles."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.geometry.shape import Shape
from mpm.scene.orifice import Orifice
from mpm.scene.validation import describe

OBLIQUE = 0.7
"""Cosine of the largest angle between a hole's axis and the shell's normal."""


@dataclass(frozen=True, eq=False)
class Collider:
    """A solid or a thin shell with Coulomb friction.
    Raises InvalidValue for a negative friction, for what is neither a shape nor a shell, for a pose that is not finite,
    for a collider that is static and mobile, or a static shell, and for orifices that are not in its shell."""

    sdf: Shape
    """Its signed distance, see `Sdf` and `Shell`."""
    friction: float = 0.5
    """Coulomb friction coefficient between collider and particles [-]."""
    pose: Pose = field(default_factory=Pose.identity)
    """Its initial pose."""
    static: bool = False
    """Whether it never moves; contact is then faster, from a table of the nodes."""
    mobile: bool = False
    """Whether contact with particles moves it, with the mobility given to `Solver.set_collider_mobility`."""
    orifices: Sequence[Orifice] = ()
    """Holes of a shell that are too small for the grid, see `Orifice`."""

    def __post_init__(self) -> None:
        if not isinstance(self.sdf, Shape):
            raise InvalidValue(f"Collider: sdf = {describe(self.sdf)}; accepted: a solid, such as "
                               f"mpm.Sdf.from_mesh(mesh), or a shell, mpm.Shell.from_mesh(mesh, thickness)")
        check_pose("Collider", self.pose)
        check_friction(self.friction)
        if self.static and self.mobile:
            raise InvalidValue("Collider: static = True and mobile = True; accepted: one of them at most")
        if self.static and self.sdf.is_thin:
            raise InvalidValue("Collider: static = True and a Shell, for which there is no table of the nodes; "
                               "accepted: static = False: a shell that is given no motion stays where it is")
        for place, orifice in enumerate(self.orifices):
            if not isinstance(orifice, Orifice):
                raise InvalidValue(f"Collider: orifices[{place}] = {describe(orifice)}; accepted: mpm.Orifice")
            if not self.sdf.is_thin:
                raise InvalidValue(f"Collider: orifices in a {type(self.sdf).__name__}; accepted: in a mpm.Shell")
            normals_at(self.sdf, orifice)


def check_friction(friction: float) -> None:
    """Raise InvalidValue for a negative friction."""
    if not friction >= 0:
        raise InvalidValue(f"Collider: friction = {friction}; accepted: 0 or more")


def normals_at(shell: Shape, orifice: Orifice) -> np.ndarray:
    """Return the normals (n, 3) of a shell's mid-surface at the holes of an orifice.
    Raises InvalidValue for a hole that is not in the shell, or whose axis is more than 45 deg off the normal."""
    normals, distance = shell.nearest_normals(orifice.positions)
    cosine = np.abs(np.einsum("nd,nd->n", normals, orifice.axes))
    for n in np.flatnonzero((distance > shell.thickness) | (cosine < OBLIQUE)):
        raise InvalidValue(f"Orifice: hole {n} at {orifice.positions[n].tolist()} m is {distance[n]:.2g} m from the "
                           f"shell's mid-surface, its axis {np.degrees(np.arccos(min(cosine[n], 1.0))):.0f} deg off "
                           f"the normal; accepted: up to {shell.thickness:.2g} m, its thickness, and 45 deg")
    return normals
