"""Colliders: rigid bodies in contact with particles."""

from dataclasses import dataclass, field

from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose
from mpm.geometry.shape import Shape
from mpm.geometry.shell import Shell


@dataclass(frozen=True, eq=False)
class Collider:
    """A solid or a thin shell with Coulomb friction.

    Raises InvalidValue for a negative friction, and for a collider that is static and mobile.
    """

    sdf: Shape | Shell
    """Its signed distance, see `Sdf` and `Shell`."""
    friction: float = 0.5
    """Coulomb friction coefficient between collider and particles [-]."""
    pose: Pose = field(default_factory=Pose.identity)
    """Its initial pose."""
    static: bool = False
    """Whether it never moves; contact is then faster, from a table of the nodes."""
    mobile: bool = False
    """Whether contact with particles moves it, with the mobility given to `Solver.set_collider_mobility`."""

    def __post_init__(self) -> None:
        if not self.friction >= 0:
            raise InvalidValue(f"Collider: friction = {self.friction}; accepted: 0 or more")
        if self.static and self.mobile:
            raise InvalidValue("Collider: static = True and mobile = True; accepted: one of them at most")
