"""Cases with independent reference solutions: each a file with its set-up, its reference and the source of that.

A case is a module with `NAME`; `SOURCE` of the reference; `measure(**choices) -> Record`; `BANDS`, the accepted errors;
`SWEEP` and `QUICK_SWEEP`, the choices that a whole and a quick report run; `CLAIMS` about the runs; `MAIN_ERROR`, the
error that is plotted against run time; and `RESOLUTION`, the choice that refines a run, or None. It may have
`compare(records) -> list[Comparison]`, plots of its runs beside reference data.

Imports: base, scene, mpm.
"""

from collections.abc import Iterable
from importlib import import_module
from types import ModuleType

from robosim.base.errors import UnknownName

SUBJECTS = {
    "free_fall": "continuum", "slow_translation": "continuum", "axis_aligned": "continuum", "bar": "continuum",
    "vortex": "continuum",
    "spin": "continuum", "elastic_energy": "continuum", "uniaxial": "continuum", "column_weight": "continuum",
    "hydrostatic": "fluid", "dam_break": "fluid", "return_mapping": "granular", "element_path": "granular",
    "slope": "granular", "heap": "granular", "column_collapse": "granular", "collapse_profile": "granular",
    "orifice": "granular", "rotating_drum": "granular",
    "chute_flow": "granular", "small_hole": "granular",
    "sleeping": "granular", "lock_gate": "fluid",
    "shell_leak": "coupling", "closed_system": "coupling", "bar_impact": "coupling", "floating_cube": "coupling",
    "block_at_rest": "coupling", "sliding_block": "coupling", "rest_height": "coupling", "carried_load": "coupling",
    "added_mass": "coupling", "swinging_ball": "coupling", "driven_wheel": "coupling",
    "plate_map": "forces", "plate_pull": "forces", "plate_drag": "forces", "retaining_wall": "forces",
    "silo_load": "forces", "dropped_sphere": "forces",
    "sleeping_scenes": "scenes",
    "ik_poses": "robot", "jerk_limits": "robot", "arm_limits": "robot", "two_models": "robot",
}
"""Name of each case -> its folder, in the order of the report."""
NAMES = tuple(SUBJECTS)
GROUPS = tuple(dict.fromkeys(SUBJECTS.values()))
"""Subjects, each of which names all of its cases."""


def expand(names: Iterable[str]) -> list[str]:
    """Return the names of cases, with all cases of a subject in its place; each once.

    Raises UnknownName for what is neither a case nor a subject.
    """
    cases: dict[str, None] = {}
    for name in names:
        if name not in SUBJECTS and name not in GROUPS:
            raise UnknownName("case", name, (*NAMES, *GROUPS))
        cases |= dict.fromkeys(case for case, subject in SUBJECTS.items() if name in (case, subject))
    return list(cases)


def module_name(name: str) -> str:
    """Return the full module name of a case. Raises UnknownName for a case that does not exist."""
    if name not in SUBJECTS:
        raise UnknownName("case", name, NAMES)
    return f"{__name__}.{SUBJECTS[name]}.{name}"


def find(name: str) -> ModuleType:
    """Import the module of a case. Raises UnknownName for a case that does not exist."""
    return import_module(module_name(name))
