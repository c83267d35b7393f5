"""Cases with independent reference solutions: each a file with its set-up, its reference and the source of that.

A case is the function `measure(**choices)` of the module of its name, which `case` makes a `Case` of.

Imports: base, coupling, scene, mpm.
"""

from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING

from robosim.base.errors import UnknownName

if TYPE_CHECKING:
    from robosim.studies.verification.cases.case import Case

CASES = {
    "continuum": ("free_fall", "slow_translation", "axis_aligned", "bar", "vortex", "spin", "elastic_energy",
                  "uniaxial", "column_weight"),
    "fluid": ("hydrostatic", "dam_break", "lock_gate"),
    "granular": ("return_mapping", "element_path", "slope", "heap", "column_collapse", "collapse_profile", "orifice",
                 "rotating_drum", "chute_flow", "small_hole", "sleeping"),
    "coupling": ("shell_leak", "closed_system", "bar_impact", "floating_cube", "block_at_rest", "sliding_block",
                 "rest_height", "carried_load", "added_mass", "swinging_ball", "driven_wheel"),
    "forces": ("plate_map", "plate_pull", "plate_drag", "retaining_wall", "silo_load", "dropped_sphere"),
    "scenes": ("sleeping_scenes",),
    "robot": ("ik_poses", "jerk_limits", "arm_limits", "two_models"),
}
"""Subject, which is a folder and names all of its cases -> their names, in the order of the report."""
SUBJECTS = {name: subject for subject, names in CASES.items() for name in names}
NAMES, GROUPS = tuple(SUBJECTS), tuple(CASES)


def expand(names: Iterable[str]) -> list[str]:
    """Return the names of cases, with all cases of a subject in its place; each once.

    Raises UnknownName for what is neither a case nor a subject.
    """
    cases: dict[str, None] = {}
    for name in names:
        if name not in SUBJECTS and name not in CASES:
            raise UnknownName("case", name, (*NAMES, *GROUPS))
        cases |= dict.fromkeys(CASES.get(name, (name,)))
    return list(cases)


def module_name(name: str) -> str:
    """Return the full module name of a case. Raises UnknownName for a case that does not exist."""
    if name not in SUBJECTS:
        raise UnknownName("case", name, NAMES)
    return f"{__name__}.{SUBJECTS[name]}.{name}"


def find(name: str) -> "Case":
    """Import a case. Raises UnknownName for a case that does not exist."""
    return import_module(module_name(name)).measure
