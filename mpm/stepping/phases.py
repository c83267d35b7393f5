"""The order of a substep: one list of phases that every stepper runs through.
A phase is a Taichi function that runs over a stretch of packs, of active blocks, or once. The stepper of a CPU runs the
phases one after the other in one launch, that of a GPU each as a parallel loop over parts, and the differentiated one
runs them forwards, and backwards through the adjoint that each names."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

from mpm.boundaries.mobile_contact import solve_mobile_contact
from mpm.boundaries.node_contact import update_nodes
from mpm.boundaries.orifice_flow import pass_orifices
from mpm.boundaries.particle_contact import note_touching, order_penetrating, stop_penetrating, stop_penetration
from mpm.boundaries.periodic import activate_home_nodes, fold_periodic, mark_images, unfold_periodic
from mpm.boundaries.shell_sides import label_nodes, label_particles, list_particles
from mpm.boundaries.shell_transfer import gather_across_shells, order_entering, scatter_across_shells, stop_at_shells
from mpm.boundaries.wall_ghosts import NoTape, fold_walls, unfold_walls
from mpm.motion.mobile_motion import start_mobile_colliders
from mpm.state.fields import Fields
from mpm.stepping.sleep_check import activate_sides
from mpm.stepping.sleep_contributions import add_sleepers, settle_with_sleepers
from mpm.transfers.cell_rates import clear_rates, sum_rates
from mpm.transfers.to_grid import add_parts, scatter_packs, start_nodes
from mpm.transfers.to_particles import check_speeds, gather_packs, list_blocks, start_block_list

Domain = Literal["packs", "packs in order", "blocks", "walls", "rows", "listed", "entering in order", "team", "once"]
"""What a phase runs over: packs of particles, active blocks, the six walls and for each the active blocks, rows of the
grid of blocks, particles listed for the transfers across shells, those of them that may enter one, or nothing: a team
of threads of a GPU, or one thread. "In order": by one thread of a CPU, as the result depends on the order."""


class Step(NamedTuple):
    """What a phase needs to know of a substep; made inside a kernel, of Taichi values."""

    row: Any  # row of the motion table
    stamp: Any  # number of the first substep of the stride, which active blocks carry
    dt: Any  # length of a substep [s]
    kick: Any  # time [s] for which nodes feel forces now: dt, or half of it at both ends of a stride
    strain: Any  # time [s] for which the particles' state advances first: dt, or 0 at the beginning of a stride
    transfer_mass: Any
    """1 where nodes take momentum and mass from the particles, 0 where they keep those of the previous substep."""
    span: Any
    """Substeps of the stride that ends with this one, after which particles move; 0 within a stride."""
    stride: Any  # length of the stride [s]
    motion: Any  # motion table (k, n, COLUMNS) of the moving colliders
    mobile: Any  # table of the mobile colliders, see `mobile_motion`
    out: Any  # ledger and status (rows, 6)
    tape: Any = NoTape()  # records walls for the adjoint
    part: Any = 0  # number of the part of the domain that this call works on
    thread: Any = 0  # number of this thread among those that share a block of nodes
    threads: int = 1  # how many these are: 1, or as many as nodes
    column: Any = 0  # number of this thread among those that share a block's columns at a wall
    columns: int = 1  # how many these are: 1, or as many as columns


class Launch(NamedTuple):
    """The arguments of a launch: substeps of one scene, and the arrays that they read and write."""

    substeps: Any
    stamp: Any  # number of the first substep
    dt: Any  # [s]
    motion: Any  # motion table (k, substeps, COLUMNS) of the moving colliders
    mobile: Any  # table of the mobile colliders, read and written
    out: Any  # written: ledger, status and the counter's readings (rows, 6)
    done: Any  # substeps of the advance in earlier launches
    interval: Any  # substeps between two readings of the counter
    per_particle: Any  # written: the counter's values of particles
    sampled: Any  # written: the sample after the last substep
    copy_to: Any  # place that the state is first copied to: NOWHERE, CHECKPOINT or UNDO
    max_stride: Any  # the most substeps between two transfers
    first_row: Any = 0  # row of the motion table of the first substep
    earlier: Any = 0
    """Readings of other environments that stand before those of this one in `per_particle`."""


class Phase(NamedTuple):
    """One phase of a substep.
    run(fields, step, first, last) works on a stretch of the domain; over "walls" it is run(fields, step, w, first,
    last) with blocks first .. last - 1 of wall w."""

    name: str
    over: Domain
    run: Callable
    is_needed: Callable[[Fields], bool]
    because: str  # what in a scene asks for it


def _lists_later(fields: Fields) -> bool:
    return not fields.grid.lists


def _has_shells(fields: Fields) -> bool:
    return bool(fields.features.shells)


ALWAYS = (lambda f: True), "every scene"
SHELL, PERIODIC = (_has_shells, "a shell"), ((lambda f: f.is_periodic), "a periodic side")
SLEEP, MOBILE = ((lambda f: f.features.sleep), "sleeping"), ((lambda f: bool(f.features.mobile)), "a mobile collider")
WALL = (lambda f: bool(f.wall_conditions)), "a wall"
CELL_RATES = (lambda f: f.features.cell_rates), 'a fluid with volume_rate="cell"'
ORDER = (
    Phase("start mobile colliders", "once", start_mobile_colliders, *MOBILE),
    Phase("list blocks", "rows", list_blocks, _lists_later, "several threads"),
    Phase("activate sides", "once", activate_sides, *SLEEP),
    Phase("activate home nodes", "blocks", activate_home_nodes, *PERIODIC),
    Phase("list blocks of home nodes", "rows", list_blocks, lambda f: f.is_periodic and _lists_later(f), PERIODIC[1]),
    Phase("label nodes", "blocks", label_nodes, *SHELL),
    Phase("list blocks of second layer", "rows", list_blocks, lambda f: _has_shells(f) and _lists_later(f), SHELL[1]),
    Phase("activate home nodes of second layer", "blocks", activate_home_nodes,
          lambda f: _has_shells(f) and f.is_periodic, "a shell and a periodic side"),
    Phase("list their blocks", "rows", list_blocks, lambda f: _has_shells(f) and f.is_periodic and _lists_later(f),
          "a shell and a periodic side"),
    Phase("label particles", "packs", label_particles, *SHELL),
    Phase("list particles", "packs in order", list_particles, *SHELL),
    Phase("start nodes", "blocks", start_nodes, lambda f: not f.parts, "every scene"),
    Phase("clear rates of cells", "blocks", clear_rates, *CELL_RATES),
    Phase("sum rates of cells", "packs in order", sum_rates, *CELL_RATES),
    Phase("scatter", "packs", scatter_packs, *ALWAYS),
    Phase("scatter across shells", "listed", scatter_across_shells, *SHELL),
    Phase("add parts", "blocks", add_parts, lambda f: f.parts > 0, "several threads"),
    Phase("add sleepers", "blocks", add_sleepers, *SLEEP),
    Phase("fold periodic sides", "blocks", fold_periodic, *PERIODIC),
    Phase("mark images", "blocks", mark_images, *PERIODIC),
    Phase("fold walls", "walls", fold_walls, *WALL),
    Phase("note touching particles", "packs", note_touching, lambda f: f.features.solids > 0, "a solid"),
    Phase("update nodes", "blocks", update_nodes, *ALWAYS),
    Phase("solve mobile contact", "team", solve_mobile_contact, *MOBILE),
    Phase("unfold walls", "walls", unfold_walls, *WALL),
    Phase("unfold periodic sides", "blocks", unfold_periodic, *PERIODIC),
    Phase("settle with sleepers", "blocks", settle_with_sleepers, *SLEEP),
    Phase("start block list", "once", start_block_list, *ALWAYS),
    Phase("gather", "packs", gather_packs, *ALWAYS),
    Phase("gather across shells", "listed", gather_across_shells, *SHELL),
    Phase("check speeds", "once", check_speeds, *ALWAYS),
    Phase("stop at shells", "listed", stop_at_shells,
          lambda f: _has_shells(f) and not set(f.features.shells) & set(f.features.mobile), "a shell"),
    Phase("order entering particles", "listed", order_entering,
          lambda f: f.shells is not None and f.shells.lists_entering, "a mobile shell on a GPU"),
    Phase("stop at mobile shells", "entering in order", stop_at_shells,
          lambda f: bool(set(f.features.shells) & set(f.features.mobile)), "a mobile shell"),
    Phase("stop penetration", "packs", stop_penetration, lambda f: bool(f.features.moving_solids), "a moving solid"),
    Phase("order penetrating particles", "packs", order_penetrating, lambda f: f.stops_later and not f.parts,
          "a mobile solid on a GPU"),
    Phase("stop penetrating particles", "once", stop_penetrating, lambda f: f.stops_later,
          "a mobile solid, and several threads"),
    Phase("pass orifices", "once", pass_orifices, lambda f: bool(f.features.orifices), "an orifice"),
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
