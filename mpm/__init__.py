"""The field: grains as a continuum, by the material point method. Knows no robot, no file, no learning."""

from mpm.backend import init
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
from mpm.geometry.region import Region
from mpm.geometry.rigid_motion import Pose, Twist, Wrench
from mpm.geometry.sdf import Sdf
from mpm.geometry.shell import Shell
from mpm.materials.elasticity import Elastic
from mpm.materials.newtonian_fluid import NewtonianFluid
from mpm.materials.plasticity import DruckerPrager, VonMises
from mpm.observers.diagnostics import Diagnostics
from mpm.observers.sample import Sample
from mpm.observers.tally import Tallied, Tally
from mpm.rollout.rollout import Rollout
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.features import Features
from mpm.scene.grid import Grid
from mpm.scene.sampling import sample_box, sample_cylinder, sample_mesh
from mpm.scene.walls import Walls
from mpm.solver import Solver
from mpm.stepping.batch import Batch

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
