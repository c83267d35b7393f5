"""Colliders: rigid bodies in contact with particles."""

from dataclasses import dataclass, field

from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose, check_pose
from mpm.geometry.shape import Shape
from mpm.geometry.shell import Shell
from mpm.scene.validation import describe


@dataclass(frozen=True, eq=False)
class Collider:
    """A solid or a thin shell with Coulomb friction.

    Raises InvalidValue for a negative friction, for what is neither a shape nor a shell, for a pose that is not finite,
    and for a collider that is static and mobile, or a static shell.
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
        if not isinstance(self.sdf, Shape | Shell):
            raise InvalidValue(f"Collider: sdf = {describe(self.sdf)}; accepted: a solid, such as "
                               f"mpm.Sdf.from_mesh(mesh), or a shell, mpm.Shell.from_mesh(mesh, thickness)")
        check_pose("Collider", self.pose)
        if not self.friction >= 0:
            raise InvalidValue(f"Collider: friction = {self.friction}; accepted: 0 or more")
        if self.static and self.mobile:
            raise InvalidValue("Collider: static = True and mobile = True; accepted: one of them at most")
        if self.static and isinstance(self.sdf, Shell):
            raise InvalidValue("Collider: static = True and a Shell, for which there is no table of the nodes; "
                               "accepted: static = False: a shell that is given no motion stays where it is")
