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
from mpm.state.fields import Fields
from mpm.stepping.phases import Phase, phases_of

ADJOINTS: dict[str, Callable | None] = {
    "label nodes": None,
    "label particles": None,
    "list particles": None,
    "start nodes": start_nodes_back,
    "scatter": scatter_back,
    "scatter across shells": None,
    "fold walls": fold_walls_back,
    "update nodes": update_nodes_back,
    "unfold walls": unfold_walls_back,
    "start block list": None,
    "check speeds": None,
    "gather": gather_back,
    "gather across shells": None,
    "stop at shells": stop_at_shells_back,
    "stop penetration": stop_penetration_back,
}
"""Name of a phase -> its adjoint; None: nothing that it changes has a derivative, or that of another phase has it:
transfers are reversed in one for all particles, those across shells among them."""


class ReverseStep(NamedTuple):
    """What an adjoint needs to know of the substep that it reverses; made inside a kernel, of Taichi values."""

    row: Any
    """Row of the motion table."""
    place: Any
    """Number of the substep in its stride."""
    span: Any
    """Substeps of the stride that ends with this one, 0 within a stride."""
    slot: Any
    """Slot of the history with the state before the substep."""
    dt: Any
    """[s]"""
    transfer_mass: Any
    """1 where nodes took momentum and mass from the particles."""
    motion: Any
    """Motion table (1, n, COLUMNS) of the tool."""
    motion_bar: Any
    """Its adjoint (n, COLUMNS), added to."""


def phases_without_adjoint(fields: Fields) -> list[Phase]:
    """Return the phases of a scene that cannot be reversed."""
    return [phase for phase in phases_of(fields) if phase.name not in ADJOINTS]


def reverse_phases(fields: Fields) -> list[Callable]:
    """Return the adjoints of a scene's phases in the order in which they are run."""
    adjoints = [ADJOINTS[phase.name] for phase in reversed(phases_of(fields))]
    return [adjoint for adjoint in adjoints if adjoint is not None]
