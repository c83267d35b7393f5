"""Checks of what a rollout can differentiate, and of its arguments."""

from mpm.errors import InvalidValue
from mpm.rollout.phases import phases_without_adjoint
from mpm.stepping.core import Core


def check_differentiable(core: Core) -> None:
    """Raise InvalidValue for a scene with something that has no adjoint."""
    features = core.features
    if not features.serial:
        raise InvalidValue("Rollout: the solver has several threads; accepted: one of mpm.init(threads=1)")
    missing = [phase.because for phase in phases_without_adjoint(core.fields)]
    missing += ["a body acceleration"] if features.body_acceleration else []
    if missing:
        raise InvalidValue(f"Rollout: the scene has {missing[0]}, which is not differentiated; accepted: "
                           "colliders that are static or given a motion, walls, gravity; sleep=False")
    if len(features.moving_colliders) > 1:
        raise InvalidValue(f"Rollout: {len(features.moving_colliders)} colliders can move; accepted: one tool at most, "
                           f"the others static")
    for body in core.scene.bodies:
        law = type(body.material)
        for function in ["stress", "return_mapping"] if law.plastic else ["stress"]:
            check_adjoint(law, function, "a law", "mpm.materials.material.Material")
    for condition in core.fields.wall_conditions:
        check_adjoint(type(condition), "slide", "a wall condition", "mpm.scene.wall_condition.WallCondition")


def check_adjoint(owner: type, function: str, what: str, protocol: str) -> None:
    """Raise InvalidValue for a class without the adjoint of one of its Taichi functions.
    An adjoint that is inherited while the function is not would be that of another function."""
    adjoint = f"{function}_back"
    ranks = [next((rank for rank, base in enumerate(owner.__mro__) if name in vars(base)), 0)
             for name in (function, adjoint)]
    reason = ""
    if not hasattr(owner, adjoint):
        reason = f"has no {adjoint}"
    elif ranks[0] < ranks[1]:
        reason = f"has a {function} of its own, but the {adjoint} of {owner.__mro__[ranks[1]].__name__}"
    if reason:
        raise InvalidValue(f"Rollout: {owner.__name__} {reason}; {what} is differentiated through its own adjoints, "
                           f"see {protocol}")
