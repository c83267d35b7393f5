"""The field: grains as a continuum, by the material point method. Knows no robot, no file, no learning."""

from mpm.adjoint.rollout import Rollout
from mpm.backend import init
from mpm.batch import Batch
from mpm.body import Body
from mpm.collider import Collider
from mpm.diagnostics import Diagnostics
from mpm.elasticity import Elastic
from mpm.errors import (
    BackendError,
    ColliderTooFast,
    GradientDiverged,
    InvalidValue,
    MpmError,
    MpmWarning,
    NarrowPassage,
    OverlappingBodies,
    SimulationDiverged,
    StrongCompression,
    TimeStepTooLarge,
    UnknownName,
)
from mpm.features import Features
from mpm.fluid import NewtonianFluid
from mpm.grid import Grid
from mpm.motion import Pose, Twist, Wrench
from mpm.plasticity import DruckerPrager, VonMises
from mpm.region import Region
from mpm.sample import Sample
from mpm.sampling import sample_box, sample_cylinder, sample_mesh
from mpm.sdf import Sdf
from mpm.shell import Shell
from mpm.solver import Solver
from mpm.tally import Tallied, Tally
from mpm.walls import Walls

__all__ = [
    "BackendError",
    "Batch",
    "Body",
    "Collider",
    "ColliderTooFast",
    "Diagnostics",
    "DruckerPrager",
    "Elastic",
    "Features",
    "GradientDiverged",
    "Grid",
    "InvalidValue",
    "MpmError",
    "MpmWarning",
    "NarrowPassage",
    "NewtonianFluid",
    "OverlappingBodies",
    "Pose",
    "Region",
    "Rollout",
    "Sample",
    "Sdf",
    "Shell",
    "SimulationDiverged",
    "Solver",
    "StrongCompression",
    "Tallied",
    "Tally",
    "TimeStepTooLarge",
    "Twist",
    "UnknownName",
    "VonMises",
    "Walls",
    "Wrench",
    "init",
    "sample_box",
    "sample_cylinder",
    "sample_mesh",
]
