"""The field: granular matter as a continuum, by the material point method (MLS-MPM).

A public name is imported where it is first used, so that `import mpm` loads neither taichi nor numpy.
"""

from typing import TYPE_CHECKING

from mpm.lazy_names import lazy_names

if TYPE_CHECKING:
    from mpm.backend import init
    from mpm.errors import (
        BackendError,
        CoarseGrains,
        ColliderJumped,
        ColliderTooFast,
        ContactNotConverged,
        GradientDiverged,
        GrainsInSolid,
        GrainsLeaveGrid,
        InvalidValue,
        MoreThreadsThanCores,
        MpmError,
        MpmWarning,
        NarrowPassage,
        OverlappingBodies,
        SimulationDiverged,
        StrongCompression,
        ThinSolid,
        TimeStepTooLarge,
        UnknownName,
        VolumeMismatch,
    )
    from mpm.geometry.region import Region
    from mpm.geometry.rigid_motion import Pose, Twist, Wrench
    from mpm.geometry.sdf import Sdf
    from mpm.geometry.shell import Shell
    from mpm.materials.drucker_prager import DruckerPrager
    from mpm.materials.elasticity import Elastic
    from mpm.materials.mu_i_rheology import MuIRheology
    from mpm.materials.newtonian_fluid import NewtonianFluid
    from mpm.materials.von_mises import VonMises
    from mpm.observers.diagnostics import Diagnostics
    from mpm.observers.region_counter import Counts, RegionCounter
    from mpm.observers.sample import Sample
    from mpm.rollout.rollout import Rollout
    from mpm.scene.body import Body
    from mpm.scene.collider import Collider
    from mpm.scene.features import Features
    from mpm.scene.grid import Grid
    from mpm.scene.initial_stress import geostatic_stress
    from mpm.scene.orifice import Orifice
    from mpm.scene.sampling import sample_box, sample_cylinder, sample_mesh
    from mpm.scene.walls import Walls
    from mpm.solver import Solver
    from mpm.stepping.batch import Batch

__all__ = [
    "BackendError",
    "Batch",
    "Body",
    "CoarseGrains",
    "Collider",
    "ColliderJumped",
    "ColliderTooFast",
    "ContactNotConverged",
    "Counts",
    "Diagnostics",
    "DruckerPrager",
    "Elastic",
    "Features",
    "GradientDiverged",
    "GrainsInSolid",
    "GrainsLeaveGrid",
    "Grid",
    "InvalidValue",
    "MoreThreadsThanCores",
    "MpmError",
    "MpmWarning",
    "MuIRheology",
    "NarrowPassage",
    "NewtonianFluid",
    "Orifice",
    "OverlappingBodies",
    "Pose",
    "Region",
    "RegionCounter",
    "Rollout",
    "Sample",
    "Sdf",
    "Shell",
    "SimulationDiverged",
    "Solver",
    "StrongCompression",
    "ThinSolid",
    "TimeStepTooLarge",
    "Twist",
    "UnknownName",
    "VolumeMismatch",
    "VonMises",
    "Walls",
    "Wrench",
    "geostatic_stress",
    "init",
    "sample_box",
    "sample_cylinder",
    "sample_mesh",
]

MODULES = {
    "mpm.backend": ("init",),
    "mpm.errors": ("BackendError", "CoarseGrains", "ColliderJumped", "ColliderTooFast", "ContactNotConverged",
        "GradientDiverged", "GrainsInSolid", "GrainsLeaveGrid", "InvalidValue", "MoreThreadsThanCores", "MpmError",
        "MpmWarning", "NarrowPassage", "OverlappingBodies", "SimulationDiverged", "StrongCompression", "ThinSolid",
        "TimeStepTooLarge", "UnknownName", "VolumeMismatch"),
    "mpm.geometry.region": ("Region",),
    "mpm.geometry.rigid_motion": ("Pose", "Twist", "Wrench"),
    "mpm.geometry.sdf": ("Sdf",),
    "mpm.geometry.shell": ("Shell",),
    "mpm.materials.drucker_prager": ("DruckerPrager",),
    "mpm.materials.elasticity": ("Elastic",),
    "mpm.materials.mu_i_rheology": ("MuIRheology",),
    "mpm.materials.newtonian_fluid": ("NewtonianFluid",),
    "mpm.materials.von_mises": ("VonMises",),
    "mpm.observers.diagnostics": ("Diagnostics",),
    "mpm.observers.region_counter": ("Counts", "RegionCounter"),
    "mpm.observers.sample": ("Sample",),
    "mpm.rollout.rollout": ("Rollout",),
    "mpm.scene.body": ("Body",),
    "mpm.scene.collider": ("Collider",),
    "mpm.scene.features": ("Features",),
    "mpm.scene.grid": ("Grid",),
    "mpm.scene.initial_stress": ("geostatic_stress",),
    "mpm.scene.orifice": ("Orifice",),
    "mpm.scene.sampling": ("sample_box", "sample_cylinder", "sample_mesh"),
    "mpm.scene.walls": ("Walls",),
    "mpm.solver": ("Solver",),
    "mpm.stepping.batch": ("Batch",),
}
"""Module -> the public names that it defines; the same as the imports above, which type checkers read."""

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazy_names(__name__, MODULES)
