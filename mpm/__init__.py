"""The field: granular matter as a continuum, by the material point method (MLS-MPM).

A public name is imported where it is first used, so that `import mpm` loads neither taichi nor numpy."""

from typing import TYPE_CHECKING

from mpm.lazy_names import lazy_names

if TYPE_CHECKING:
    from mpm.backend import init
    from mpm.batch.batch import Batch
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
    from mpm.materials.drucker_prager import DruckerPrager, MuIRheology
    from mpm.materials.elasticity import Elastic
    from mpm.materials.newtonian_fluid import NewtonianFluid
    from mpm.materials.von_mises import VonMises
    from mpm.observers.diagnostics import Diagnostics
    from mpm.observers.reading_kernels import Sample
    from mpm.observers.region_counter import Counts, RegionCounter
    from mpm.rollout.rollout import Rollout
    from mpm.scene.body import Body
    from mpm.scene.collider import Collider
    from mpm.scene.features import Features
    from mpm.scene.grid import Grid
    from mpm.scene.initial_stress import geostatic_stress
    from mpm.scene.orifice import Orifice
    from mpm.scene.sampling import sample_box, sample_mesh
    from mpm.scene.walls import Walls
    from mpm.solver import Solver

if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
