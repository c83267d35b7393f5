"""Cases with independent reference solutions, each with its set-up, its reference and the source of that.

A case is the function of its name, which `case` makes a `Case` of; its docstring is the case's page. Choices that
cases share: cell of the grid [m]; courant: of `beds.courant_step`; precision, contact and transfer_interval (0 without
strides): see `mpm.Solver`; volume_rate: see `mpm.NewtonianFluid`; face_cells: see `mpm.Shell.from_mesh`; E or
stiffness: Young's modulus [Pa]; mass [kg]; duration [s]; host_step: of MuJoCo [s]; friction_deg: whose tangent the sand
carries in simple shear; phi_deg: friction angle [deg].

Imports: base, config, coupling, scene, mpm."""

from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING

from robosim.base.errors import UnknownName

if TYPE_CHECKING:
    from robosim.studies.verification.cases.case import Case

MODULES = {
    "continuum.motion": ("free_fall", "slow_translation", "spin", "bar", "elastic_energy"),
    "continuum.manufactured": ("axis_aligned", "vortex"), "continuum.statics": ("uniaxial", "column_weight"),
    "fluid.water": ("hydrostatic", "dam_break", "lock_gate"), "fluid.lifted_columns": ("lifted_column",),
    "granular.element": ("return_mapping", "element_path"), "granular.slopes": ("slope", "heap", "chute_flow"),
    "granular.collapse_profile": ("collapse_profile",),
    "granular.discharge": ("orifice", "small_hole"), "granular.rotating_drum": ("rotating_drum",),
    "granular.drum_layer": ("drum_layer", "drum_slope"),
    "granular.outflow": ("lifted_gate", "slot_of_beads", "lifted_can"),
    "granular.sleeping": ("sleeping",),
    "coupling.shell_leak": ("shell_leak",), "coupling.impacts": ("closed_system", "bar_impact"),
    "coupling.floating": ("floating_cube",),
    "coupling.blocks": ("block_at_rest", "sliding_block", "rest_height"),
    "coupling.carriages": ("carried_load",), "coupling.swinging_ball": ("swinging_ball",),
    "forces.plates": ("plate_map", "plate_pull"), "forces.round_plates": ("round_plate",),
    "forces.walls": ("plate_drag", "retaining_wall", "silo_load"),
    "forces.dropped_sphere": ("dropped_sphere",), "scenes.sleeping_scenes": ("sleeping_scenes",),
    "scenes.longer_steps": ("longer_steps",),
    "robot.kinematics": ("ik_poses", "jerk_limits", "two_models"),
}
"""Module, which begins with the subject, -> names of its cases, in the order of the report."""
PLACES = {name: place for place, names in MODULES.items() for name in names}
SUBJECTS = {name: place.partition(".")[0] for name, place in PLACES.items()}
CASES = {subject: tuple(name for name in PLACES if SUBJECTS[name] == subject) for subject in SUBJECTS.values()}
"""Subject, which stands for all of its cases, -> their names."""
NAMES, GROUPS = tuple(PLACES), tuple(CASES)


def expand(names: Iterable[str]) -> list[str]:
    """Return the names of cases, with all cases of a subject in its place; each once.
    Raises UnknownName for what is neither a case nor a subject."""
    cases: dict[str, None] = {}
    for name in names:
        if name not in PLACES and name not in CASES:
            raise UnknownName("case", name, (*NAMES, *GROUPS))
        cases |= dict.fromkeys(CASES.get(name, (name,)))
    return list(cases)


def module_name(name: str) -> str:
    """Return the full module name of a case. Raises UnknownName for a case that does not exist."""
    if name not in PLACES:
        raise UnknownName("case", name, NAMES)
    return f"{__name__}.{PLACES[name]}"


def find(name: str) -> "Case":
    """Import a case. Raises UnknownName for a case that does not exist."""
    return getattr(import_module(module_name(name)), name)
