"""Rigid bodies that grains meet."""

from dataclasses import dataclass, field

from mpm.errors import InvalidValue
from mpm.geometry.compound import Solid, Union
from mpm.geometry.rigid_motion import Pose
from mpm.geometry.shell import Shell

Shape = Solid | Union | Shell


@dataclass(frozen=True, eq=False)
class Collider:
    """A solid or a shell with Coulomb friction. A static solid never moves; it costs a lookup a node."""

    sdf: Shape
    friction: float = 0.5
    """Coulomb coefficient against grains."""
    pose: Pose = field(default_factory=Pose.identity)
    """Where it starts."""
    static: bool = False
    mobile: bool = False
    """Contact with grains moves it too; `Solver.set_collider_mobility` says how it answers."""

    def __post_init__(self) -> None:
        if not self.friction >= 0:
            raise InvalidValue(f"Collider: friction = {self.friction}; accepted: 0 or more")
        if self.static and self.mobile:
            raise InvalidValue("Collider: static and mobile; a collider is one or the other")
