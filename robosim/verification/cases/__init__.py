"""Cases with independent reference solutions: each a file with its set-up, its reference and the source of that.

A case has `NAME`, `SOURCE`, `measure(**choices) -> Record` and `BANDS`, the accepted range of each error at named
choices. `robosim.verification.cases.find(name)` imports one.

Imports: errors, scene, mpm.
"""

from importlib import import_module
from types import ModuleType

from robosim.errors import UnknownName

SUBJECTS = {
    "free_fall": "continuum", "axis_aligned": "continuum", "bar": "continuum", "vortex": "continuum",
    "spin": "continuum", "elastic_energy": "continuum", "uniaxial": "continuum", "column_weight": "continuum",
    "hydrostatic": "fluid", "dam_break": "fluid", "return_mapping": "granular", "element_path": "granular",
    "slope": "granular", "heap": "granular", "column_collapse": "granular", "orifice": "granular", "lock_gate": "fluid",
    "shell_leak": "coupling", "closed_system": "coupling", "bar_impact": "coupling", "floating_cube": "coupling",
    "block_at_rest": "coupling", "carried_load": "coupling", "added_mass": "coupling", "driven_wheel": "coupling",
    "ik_poses": "robot", "jerk_limits": "robot", "arm_limits": "robot", "two_models": "robot",
}
"""Name of each case -> its folder, in the order of the report."""
NAMES = tuple(SUBJECTS)


def module_name(name: str) -> str:
    """The module of a case, with its packages; raises UnknownName."""
    if name not in SUBJECTS:
        raise UnknownName("case", name, NAMES)
    return f"{__name__}.{SUBJECTS[name]}.{name}"


def find(name: str) -> ModuleType:
    """The module of a case; raises UnknownName."""
    return import_module(module_name(name))
