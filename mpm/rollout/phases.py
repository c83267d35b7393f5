"""The adjoint of each phase of a substep, by the phase's name.
A scene whose phases all stand here can be differentiated. Each adjoint is called as run(adjoint, step): `adjoint` is
the `AdjointKernel` with the fields, `step` says which substep is reversed."""

from collections.abc import Callable
from typing import Any, NamedTuple

from mpm.adjoint.contact import stop_penetration_back, update_nodes_back
from mpm.adjoint.node_tape import start_nodes_back
from mpm.adjoint.shell_contact import stop_at_shells_back
from mpm.adjoint.transfers import gather_back, scatter_back
from mpm.adjoint.wall_ghosts import fold_walls_back, unfold_walls_back
from mpm.errors import InvalidValue
from mpm.materials.material import stiffens_with_density
from mpm.state.fields import Fields
from mpm.stepping.core import Core
from mpm.stepping.phases import phases_of

ADJOINTS: dict[str, Callable | None] = {
    "label nodes": None, "label particles": None, "list particles": None, "start nodes": start_nodes_back,
    "scatter": scatter_back, "scatter across shells": None,
    "fold walls": fold_walls_back, "note touching particles": None, "update nodes": update_nodes_back,
    "unfold walls": unfold_walls_back,
    "start block list": None, "check speeds": None, "gather": gather_back, "gather across shells": None,
    "stop at shells": stop_at_shells_back, "stop penetration": stop_penetration_back}
"""Name of a phase -> its adjoint; None: nothing that it changes has a derivative, or that of another phase has it:
transfers are reversed in one for all particles, those across shells among them."""


class ReverseStep(NamedTuple):
    """What an adjoint needs to know of the substep that it reverses; made inside a kernel, of Taichi values."""

    row: Any  # row of the motion table
    begin: Any  # that of the stride's first substep
    place: Any  # number of the update of nodes in its stride
    span: Any  # substeps of the stride that ends with this one, 0 within a stride
    slot: Any  # slot of the history with the state before the substep
    dt: Any  # length of a substep [s]
    kick: Any  # time [s] for which nodes felt forces
    strain: Any  # time [s] for which the particles' state advanced first
    stride: Any  # length of the stride [s]
    transfer_mass: Any  # 1 where nodes took momentum and mass from the particles
    motion: Any  # motion table (1, n, COLUMNS) of the tool
    motion_bar: Any  # its adjoint (n, COLUMNS), added to


def reverse_phases(fields: Fields) -> list[Callable]:
    """Return the adjoints of a scene's phases in the order in which they are run."""
    adjoints = [ADJOINTS[phase.name] for phase in reversed(phases_of(fields))]
    return [adjoint for adjoint in adjoints if adjoint is not None]


def check_differentiable(core: Core) -> None:
    """Raise InvalidValue for a scene with something that has no adjoint."""
    features = core.features
    if not features.serial:
        raise InvalidValue("Rollout: the solver has several threads; accepted: one of mpm.init(threads=1)")
    missing = [phase.because for phase in phases_of(core.fields) if phase.name not in ADJOINTS]
    missing += ["a body acceleration"] if features.body_acceleration else []
    if missing:
        raise InvalidValue(f"Rollout: the scene has {missing[0]}, which is not differentiated; accepted: "
                           "colliders that are static or given a motion, walls, gravity; sleep=False")
    if len(features.moving_colliders) > 1:
        raise InvalidValue(f"Rollout: {len(features.moving_colliders)} colliders can move; accepted: one tool at most, "
                           f"the others static")
    for body in core.scene.bodies:
        law = type(body.material)
        functions = ["stress", *["return_mapping"] * law.plastic, *["soften"] * stiffens_with_density(body.material)]
        for function in functions:
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
