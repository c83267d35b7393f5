"""The solver: bodies, colliders and walls on one grid, advanced by explicit MLS-MPM."""

from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from mpm.errors import InvalidValue
from mpm.geometry.rigid_motion import Pose, Twist, Wrench, check_pose
from mpm.materials.material import Material
from mpm.observers import diagnostics
from mpm.observers.diagnostics import Diagnostics, Energy
from mpm.observers.reading_kernels import Sample
from mpm.observers.readings import Momentum, Readings, received
from mpm.observers.region_counter import Counts, RegionCounter
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.grid import Grid
from mpm.scene.scene import DOWN, Numerics, Scene, check_colliders
from mpm.scene.validation import check_finite
from mpm.scene.walls import Walls
from mpm.scene.warnings import warn_of_colliders, warn_of_scene
from mpm.stepping.core import Core
from mpm.time_loop import TimeLoop


class Solver(Readings, AbstractContextManager["Solver"]):
    """Explicit MLS-MPM solver of one scene: grid, bodies, colliders and walls.

    - gravity [m/s^2] (3,); body_acceleration: that of each particle besides gravity [m/s^2] (n_particles, 3).
    - dt: substep [s]; None: 0.75 of `bound`; above 0.83 of it: TimeStepTooLarge. Substeps become smaller where a
      collider would move more than a quarter of a cell in one.
    - precision: "f32", "f64" or None (that of `init`).
    - integrator of Hencky strain: "series", accurate for small strain; "exact", by eigenvalues; "auto", by eigenvalues
      where the series is not accurate; None: "auto" in f32, "exact" in f64.
    - transfer_interval: longest stride [s], the time between two transfers of velocities to the particles; 0: one
      substep. "strides": 6.5 times that bound, 0 with a fluid; None: the same, and 0 with a mobile collider.
    - sleep: whether particles at rest sleep and cost nothing; a number: a factor on `mpm.stepping.sleep_thresholds`.

    The last five are the fields of `numerics`. `settings` has further numbers that can be set."""

    def __init__(self, *, grid: Grid, bodies: list[Body], colliders: list[Collider] | None = None,
                 gravity: tuple[float, float, float] = DOWN, walls: Walls | None = None,
                 body_acceleration: np.ndarray | None = None, **numerics: Any) -> None:
        scene = Scene(grid, bodies, colliders or [], Walls() if walls is None else walls, np.asarray(gravity))
        self.numerics = Numerics(**numerics).chosen(scene.bodies)
        warn_of_scene(scene)
        self._has_accelerations = body_acceleration is not None
        self._build(scene)
        if body_acceleration is not None:
            self.set_body_acceleration(body_acceleration)

    def _build(self, scene: Scene) -> None:
        """Make the parts of the solver, and the kernels that read its fields."""
        self.core = core = Core(scene, self.numerics, self._has_accelerations)
        super().__init__(core.tenure, scene, core.progress)
        self.grid, self.bodies, self.colliders, self.walls = scene.grid, scene.bodies, scene.colliders, scene.walls
        self.features, self.paths, self.mobility = core.features, core.paths, core.mobility
        self.readings, self.settings, self.rollback = core.readings, core.settings, core.rollback
        self.precision, self.sleep = core.precision, core.sleep
        self.loop = TimeLoop(core)

    @property
    def counter(self) -> RegionCounter | None:
        """The attached counter."""
        return self.core.counter

    @property
    def dt(self) -> float:
        """Largest substep [s]."""
        return self.core.dt

    @property
    def bound(self) -> float:
        """Bound of the substep [s]; `dt` is accepted up to `stable_step.ACCEPTED_FRACTION` of it."""
        return self.settings.bound

    @property
    def transfer_interval(self) -> float:
        """Longest stride [s] with the current materials and colliders."""
        return self.core.transfer_interval

    @property
    def time(self) -> float:
        """Time [s] since the start."""
        return self.progress.time

    @property
    def steps(self) -> int:
        """Substeps since the start."""
        return self.progress.steps

    @property
    def substep(self) -> float:
        """Length [s] of the last substep."""
        return self.progress.substep

    @property
    def gravity(self) -> np.ndarray:
        """Gravity [m/s^2] (3,)."""
        return self.scene.gravity

    # scene -----------------------------------------------------------------------------------------------------------
    def set_colliders(self, colliders: list[Collider]) -> None:
        """Replace all colliders, before the first advance; particles are unchanged."""
        if self.steps > 0 or self.counter is not None:
            raise InvalidValue("set_colliders: the scene is fixed by the first advance or an attached counter; "
                               "accepted: colliders that are set before")
        check_colliders(colliders)
        before, scene = self.state(), self.scene
        self.close()
        scene.colliders[:] = colliders
        warn_of_colliders(scene)
        self._build(scene)
        for name, fields in self.particles.named_fields().items():
            if name in before:
                self.particles.write(fields, before[name])

    def attach(self, counter: RegionCounter, sample: Sample | None = None) -> None:
        """Attach a counter, evaluated during advances, and a sample, taken at their end; kernels are recompiled."""
        if counter.tenure is not self.core.tenure or counter.index not in self.features.moving_colliders:
            raise InvalidValue("attach: the counter is of another solver or of other colliders, or its collider cannot "
                               "move; accepted: a RegionCounter of this solver and of a moving collider")
        if sample is not None and sample.tenure is not self.core.tenure:
            raise InvalidValue("attach: the sample is of another solver; accepted: a Sample of this solver")
        self.core.counter, self.core.sample = counter, sample
        self.loop.make_stepper()

    def before_flags_change(self, counter: RegionCounter) -> None:
        """Complete a pending checkpoint before the flags of an attached counter change."""
        if self.counter is counter:
            self.rollback.store_pending()

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Set gravity [m/s^2] (3,); wakes all particles."""
        self.settings.set_gravity(gravity)

    def set_friction(self, index: int, friction: float) -> None:
        """Set the friction coefficient of a collider, without recompilation."""
        self.settings.set_friction(index, friction)

    def set_material(self, index: int, material: Material) -> None:
        """Set other parameters of a body's law, without recompilation; raises TimeStepTooLarge if dt is too large."""
        self.settings.set_material(index, material)

    def set_body_acceleration(self, accelerations: np.ndarray) -> None:
        """Set accelerations besides gravity [m/s^2] (n_particles, 3); only if the solver was made with some."""
        if not self.features.body_acceleration:
            raise InvalidValue("set_body_acceleration: the solver has none; build it with body_acceleration=(n, 3) or "
                               "zeros")
        values = check_finite("body_acceleration", accelerations, (sum(self.particles.counts), 3))
        self.rollback.store_pending()
        self.particles.write(self.particles.acceleration, values)

    # colliders -------------------------------------------------------------------------------------------------------
    def set_collider_motion(self, index: int, begin: Pose, *ends: Pose, jump: bool = False) -> None:
        """Move a collider in the next advance by a screw motion from begin to end, or to ends at equal intervals.
        jump: whether it may begin elsewhere than at `collider_pose`; otherwise that is reported (ColliderJumped)."""
        self.paths.set(index, begin, ends, jump)

    def set_collider_mobility(self, index: int, W: np.ndarray, free_twist: np.ndarray, *,
                              twist: np.ndarray | None = None, pose: Pose | None = None,
                              centre: np.ndarray | None = None, others: dict[int, np.ndarray] | None = None) -> None:
        """Set how a mobile collider responds to contact in the next advance, and how it moves without contact.

        W: mobility (6, 6): change of twist (linear, angular) per impulse (same order), in world axes about `centre`,
        symmetric and positive semi-definite. free_twist: twist (6,) at the end of the advance without contact. twist,
        pose: current ones; None: those at the end of the last advance. centre: [m] (3,); None: the frame's origin.
        others: index of a mobile collider -> change (6, 6) of this twist per impulse on it. Raises InvalidValue."""
        if index not in self.features.mobile:
            raise InvalidValue(f"collider {index} is not mobile; mobile: {self.features.mobile}")
        place = self.paths.poses[index] if pose is None else check_pose(f"mobility of collider {index}", pose)
        self.mobility.set(index, place, W, free_twist, twist, centre, others or {})
        self.paths.poses[index] = place

    def collider_pose(self, index: int) -> Pose:
        """Return the pose of a collider at the end of the last advance."""
        return self.paths.pose(index)

    def collider_twist(self, index: int) -> Twist:
        """Return the twist of a mobile collider about its centre at the end of the last advance."""
        return self.mobility.twist(index)

    def collider_impulse(self, index: int, about: np.ndarray | None = None) -> Wrench:
        """Return the impulse [N s], [N m s] that a collider received in the last advance.
        about: point [m] (3,), or None: the centre of a mobile collider as it moved, the origin of another at the end of
        the advance."""
        here = self.paths.pose(index).position
        if about is None and index in self.features.mobile:
            return self.mobility.impulse(index)
        return received(self.ledger[self.fields.rows.first_collider + index], here if about is None else about)

    @property
    def contact_residual(self) -> float:
        """Largest residual of the contact solves of mobile colliders in the last advance; 0 without such colliders.
        Relative to the change of the collider's twist by contact. Above 0.01 `advance` warns."""
        return self.mobility.residual

    # time ------------------------------------------------------------------------------------------------------------
    def compile(self) -> None:
        """Compile the kernels now instead of in the first advance; nothing moves."""
        self.loop.compile()

    def advance(self, duration: float, readings: int = 1) -> list[Counts]:
        """Advance by `duration` [s] in equal substeps of at most `dt`.

        Returns the counts of the attached counter after each of `readings` equal intervals; an empty list without one.
        Raises SimulationDiverged in the substep in which a value is not finite or a particle moves more than a cell,
        and ColliderTooFast if a collider would need too many substeps. After any error, and after Ctrl-C, the solver is
        in the state that it was in before."""
        return self.loop.advance(duration, readings)

    # states ----------------------------------------------------------------------------------------------------------
    def store_checkpoint(self) -> None:
        """Store a copy of the state in the memory of the device, until the next call; much faster than `state`."""
        self.rollback.store()

    def restore_checkpoint(self) -> None:
        """Restore the stored checkpoint, any number of times; raises InvalidValue if there is none."""
        self.rollback.restore()

    def state(self) -> dict[str, np.ndarray]:
        """Return the state, for a bitwise identical continuation; it has no parameters such as gravity."""
        return self.core.state()

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Load a state of this solver, or of one made from the same scene.
        Raises InvalidValue, and changes nothing, for a state of another scene."""
        self.core.load(state)

    def close(self) -> None:
        """Give the fields back for the next solver of an equal scene; this one is of no more use.
        Also called at the end of a `with` block, and when the last reference is gone."""
        self.core.tenure.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    # readings --------------------------------------------------------------------------------------------------------
    def clearance(self, index: int, pose: Pose | None = None) -> float:
        """Return a lower bound [m] of the distance of the nearest particle from a collider, at a pose or where it is.
        See `Readings.clearance`."""
        return super().clearance(index, self.paths.pose(index) if pose is None else check_pose("clearance", pose))

    def momentum(self) -> Momentum:
        """Return the momentum of all particles, summed in float64."""
        return diagnostics.compute_momentum(self)

    def energy(self) -> Energy:
        """Return the energy of all particles, summed in float64; the elastic part is each law's own."""
        return diagnostics.compute_energy(self)

    def diagnostics(self) -> Diagnostics:
        """Return mass, momentum, energy, CFL number, and the numbers of escaped and non-finite particles."""
        return diagnostics.compute_diagnostics(self)

    def momentum_after_advance(self) -> Momentum:
        """Return the momentum after the last advance or load, summed in the kernel without a copy of the state."""
        return diagnostics.momentum_after_advance(self)
