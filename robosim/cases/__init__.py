"""Cases with answers that nobody here wrote: each a file with its set-up, its reference and the source of that.

A case has `NAME`, `SOURCE`, `measure(**choices) -> Record` and `BANDS`, the accepted range of each error at named
choices. `robosim.cases.find(name)` imports one.
"""

from importlib import import_module
from types import ModuleType

from robosim.errors import UnknownName

NAMES = (
    "free_fall", "axis_aligned", "bar", "vortex", "spin", "elastic_energy", "uniaxial", "column_weight",
    "hydrostatic", "dam_break", "return_mapping", "element_path", "slope", "heap", "column_collapse", "orifice",
    "lock_gate", "shell_leak", "closed_system", "bar_impact", "floating_cube", "block_at_rest", "carried_load",
    "added_mass", "driven_wheel", "ik_poses", "jerk_limits", "arm_limits", "two_models",
)


def find(name: str) -> ModuleType:
    """The module of a case; raises UnknownName."""
    if name not in NAMES:
        raise UnknownName("case", name, NAMES)
    return import_module(f"robosim.cases.{name}")
