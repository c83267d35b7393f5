"""The order of a substep: one list of phases that every stepper runs through.

A phase is a Taichi function that runs over a stretch of packs, of active blocks, or once. The serial stepper runs the
phases one after the other in one launch, the parallel one each as a parallel loop over parts, and the differentiated
one runs them forwards, and backwards through the adjoint that each names.
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from mpm.boundaries.contact import stop_penetration, update_nodes
from mpm.boundaries.mobile_contact import solve_mobile_contact
from mpm.boundaries.mobile_motion import start_mobile_colliders
from mpm.boundaries.periodic import fold_periodic, unfold_periodic
from mpm.boundaries.shell_sides import label_shell_sides
from mpm.boundaries.shell_transfer import gather_across_shells, scatter_across_shells
from mpm.boundaries.wall_ghosts import NoTape, fold_walls, unfold_walls
from mpm.state.fields import Fields
from mpm.stepping.sleep_settle import settle_with_sleepers
from mpm.transfers.to_grid import add_parts, scatter_packs, start_nodes
from mpm.transfers.to_particles import check_speeds, gather_packs, list_blocks, start_block_list

Domain = Literal["packs", "blocks", "walls", "rows", "once"]
"""What a phase runs over: packs of particles, active blocks, the six walls and for each the active blocks, rows of the
grid of blocks, or nothing (one thread, one call)."""


class Step(NamedTuple):
    """What a phase needs to know of a substep; made inside a kernel, of Taichi values."""

    row: Any
    """Row of the motion table."""
    stamp: Any
    """Number of the first substep of the stride, which active blocks carry."""
    dt: Any
    """[s]"""
    transfer_mass: Any
    """1 where nodes take momentum and mass from the particles, 0 where they keep those of the previous substep."""
    span: Any
    """Substeps of the stride that ends with this one, after which particles move; 0 within a stride."""
    motion: Any
    """Motion table (k, n, COLUMNS) of the moving colliders."""
    mobile: Any
    """Table of the mobile colliders, see `mobile_motion`."""
    out: Any
    """Ledger and status (rows, 6)."""
    tape: Any = NoTape()
    """Records walls for the adjoint."""
    shift: Any = 0
    """Nodes along x from the beginning of the scatter target to the array of this part."""


class Phase(NamedTuple):
    """One phase of a substep.

    run(fields, step, first, last) works on a stretch of the domain; over "walls" it is run(fields, step, w, first,
    last) with blocks first .. last - 1 of wall w.
    """

    name: str
    over: Domain
    run: Callable
    is_needed: Callable[[Fields], bool]
    because: str
    """What in a scene asks for it."""


def _always(fields: Fields) -> bool:
    return True


ORDER = (
    Phase("start nodes", "blocks", start_nodes, lambda f: not f.parts, "every scene"),
    Phase("start mobile colliders", "once", start_mobile_colliders, lambda f: bool(f.features.mobile),
          "a mobile collider"),
    Phase("label shell sides", "once", label_shell_sides, lambda f: bool(f.features.shells), "a shell"),
    Phase("scatter", "packs", scatter_packs, _always, "every scene"),
    Phase("scatter across shells", "once", scatter_across_shells, lambda f: bool(f.features.shells), "a shell"),
    Phase("add parts", "blocks", add_parts, lambda f: f.parts > 0, "several threads"),
    Phase("fold periodic sides", "once", fold_periodic, lambda f: f.is_periodic, "a periodic side"),
    Phase("fold walls", "walls", fold_walls, lambda f: bool(f.wall_conditions), "a wall"),
    Phase("update nodes", "blocks", update_nodes, _always, "every scene"),
    Phase("solve mobile contact", "once", solve_mobile_contact, lambda f: bool(f.features.mobile),
          "a mobile collider"),
    Phase("unfold walls", "walls", unfold_walls, lambda f: bool(f.wall_conditions), "a wall"),
    Phase("unfold periodic sides", "once", unfold_periodic, lambda f: f.is_periodic, "a periodic side"),
    Phase("settle with sleepers", "blocks", settle_with_sleepers, lambda f: f.features.sleep, "sleeping"),
    Phase("start block list", "once", start_block_list, _always, "every scene"),
    Phase("gather", "packs", gather_packs, _always, "every scene"),
    Phase("gather across shells", "once", gather_across_shells, lambda f: bool(f.features.shells), "a shell"),
    Phase("check speeds", "once", check_speeds, _always, "every scene"),
    Phase("stop penetration", "packs", stop_penetration, lambda f: bool(f.features.moving_solids), "a moving solid"),
    Phase("list blocks", "rows", list_blocks, lambda f: not f.grid.lists, "several threads"),
)
"""All phases, in the order of a substep."""
FIRST_OF_PARTICLES = "start block list"
"""The phase with which the part of a substep begins that changes particles; those before it change nodes."""


def phases_of(fields: Fields) -> tuple[Phase, ...]:
    """Return the phases that a scene needs, in order."""
    return tuple(phase for phase in ORDER if phase.is_needed(fields))


def split_phases(fields: Fields) -> tuple[tuple[Phase, ...], tuple[Phase, ...]]:
    """Return the phases of a scene that change nodes, and those after them that change particles."""
    phases = phases_of(fields)
    names = [phase.name for phase in phases]
    cut = names.index(FIRST_OF_PARTICLES)
    return phases[:cut], phases[cut:]
