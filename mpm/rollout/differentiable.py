"""What a roll-out can be differentiated for."""

from mpm.errors import InvalidValue


def check_scene(solver) -> None:  # noqa: ANN001  (a Solver; a cycle otherwise)
    """Raise InvalidValue for a scene with something that has no adjoint."""
    features = solver.features
    if solver.shares is not None:
        raise InvalidValue("Rollout: the solver has several threads; accepted: one of mpm.init(threads=1)")
    for name, present in (("a shell", features.shells), ("a mobile collider", features.mobile),
                          ("a periodic side", any(features.periodic)),
                          ("a body acceleration", features.body_acceleration)):
        if present:
            raise InvalidValue(f"Rollout: the scene has {name}, which is not differentiated; accepted: solid colliders "
                               "that are static or given a motion, walls, gravity")
    if len(features.moving_solids) > 1:
        raise InvalidValue(f"Rollout: {len(features.moving_solids)} colliders can move; accepted: one tool at most, "
                           f"the others static")
    for body in solver.bodies:
        law = type(body.material)
        needed = ["stress_back", "return_mapping_back"] if getattr(law, "plastic", False) else ["stress_back"]
        missing = [name for name in needed if not hasattr(law, name)]
        if missing:
            raise InvalidValue(f"Rollout: {law.__name__} has no {missing[0]}; a law is differentiated through its own")
