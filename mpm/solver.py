"""The solver: bodies, colliders and walls on one grid, advanced by explicit MLS-MPM."""

import math
from dataclasses import replace

import numpy as np

from mpm.adjusting import Adjustable
from mpm.backend import check_owner, default_precision, is_shared, ti
from mpm.boundaries.contact import cache_static_contact
from mpm.boundaries.mobility_table import MobilityTable
from mpm.errors import InvalidValue, SimulationDiverged
from mpm.geometry.rigid_motion import COLUMNS, Pose, Twist, check_pose
from mpm.gpu.stepper import count_parts, make_stepper
from mpm.materials.stable_step import choose_step, material_bound
from mpm.observers import diagnostics
from mpm.observers.counter_kernel import COUNTER_ROWS
from mpm.observers.diagnostics import Momentum
from mpm.observers.region_counter import MAX_READINGS, Counts, RegionCounter
from mpm.observers.sample import Sample
from mpm.scene.body import Body
from mpm.scene.collider import Collider
from mpm.scene.features import Contact, check_colliders, check_scene, choose_numerics, features_of
from mpm.scene.grid import ROUNDING, Grid
from mpm.scene.validation import check_finite, read_array
from mpm.scene.walls import Walls
from mpm.scene.warnings import warn_of_colliders, warn_of_scene
from mpm.state.fields import allocate_fields, fill_fields, scene_key
from mpm.state.memory import check_memory
from mpm.state.particles import SPEED_LIMIT
from mpm.stepping.collider_paths import ColliderPaths
from mpm.stepping.cpu import NOWHERE, UNDO
from mpm.stepping.rollback import Rollback
from mpm.stepping.sleep_thresholds import read_sleep
from mpm.stepping.stride import Interval, choose_interval, longest_stride, split_launches


class Solver(Adjustable):
    """Explicit MLS-MPM solver of one scene: grid, bodies, colliders and walls.

    - dt: substep [s]; None: 0.75 of the bound of an isolated particle; above 0.83 of it: TimeStepTooLarge. Substeps
      become smaller where a collider would move more than a quarter of a cell in one.
    - precision: "f32", "f64" or None (that of `init`).
    - integrator of Hencky strain: "series", accurate for small strain; "exact", by eigenvalues; "auto", by eigenvalues
      where the series is not accurate; None: "auto" in f32, "exact" in f64.
    - transfer_interval: longest stride [s], the time between two transfers of velocities to the particles; 0: one
      substep. "strides": 3 times that bound, 0 with a fluid; None: the same, and 0 with a mobile collider.
    - sleep: whether particles at rest sleep and cost nothing; a number: a factor on `mpm.stepping.sleep_thresholds`.
    - contact: solids stop all material within half a cell, "near", or only what lies at one of their faces, "touching".
    - gravity [m/s^2] (3,); body_acceleration: that of each particle besides gravity [m/s^2] (n_particles, 3).
    """

    def __init__(
        self, *, grid: Grid, bodies: list[Body], colliders: list[Collider] | None = None,
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.81), walls: Walls | None = None, contact: Contact = "near",
        dt: float | None = None, precision: str | None = None, integrator: str | None = None,
        body_acceleration: np.ndarray | None = None, transfer_interval: Interval = None, sleep: bool | float = False,
    ) -> None:
        check_scene(grid, bodies, colliders, walls)
        self.precision, self.integrator = choose_numerics(bodies, precision, integrator)
        self.grid, self.bodies, self.colliders = grid, list(bodies), list(colliders or [])
        self.walls = walls or Walls()
        self.walls.check(grid)
        self.gravity = check_finite("Solver: gravity", gravity, (3,))
        warn_of_scene(grid, self.bodies, self.colliders, self.gravity)
        self.bound = min(material_bound(grid.cell, body.material) for body in bodies)
        """Bound of an isolated particle [s]; `dt` is accepted up to `stable_step.ACCEPTED_FRACTION` of it."""
        self.requested_dt, self.requested_interval, self.sleep = dt, transfer_interval, read_sleep(sleep)
        self.dt = choose_step(dt, grid.cell, [body.material for body in bodies])
        self.time, self.steps, self.substep = 0.0, 0, self.dt
        self.counter: RegionCounter | None = None
        self.sample: Sample | None = None
        self._has_warned_of_held, self._fastest = False, None
        self._per_particle, self._unsampled = np.zeros((1, 1, 2), np.float32), np.zeros((1, 6), np.float32)
        self._has_accelerations, self.contact = body_acceleration is not None, contact
        self._build()
        if body_acceleration is not None:
            self.set_body_acceleration(body_acceleration)

    def _build(self) -> None:
        """Allocate the fields that the scene asks for, and the kernels that read them."""
        self.features = features_of(self.bodies, self.colliders, self.walls, self.precision, self.integrator,
                                    self._has_accelerations, self.transfer_interval > 0, self.sleep > 0, self.contact)
        self.mobility = MobilityTable(self.features.mobile)
        self.paths = ColliderPaths(self.colliders, self.features, self.mobility, self.grid)
        self._take_assembly()
        self.rollback = Rollback(self)
        with default_precision(self.precision):
            fill_fields(self.fields, self.grid, self.bodies, self.colliders, self.gravity, self.walls)
            self.wake()
            origin, cell, static = ti.Vector(self.grid.origin, ti.f64), self.grid.cell, self.features.static_colliders
            for i in static:
                place = np.concatenate([self.colliders[i].pose.position, self.colliders[i].pose.matrix.ravel()])
                cache_static_contact(self.fields.static_contact, self.colliders[i].sdf, i, i == static[0],
                                     place, origin, cell, is_shared(), self.features.touching)
        self._make_stepper()
        self.sums = np.zeros((self.fields.rows.count, 6))
        """Sums of the last advance, see `LedgerRows`."""
        self._momentum = None

    def _take_assembly(self) -> None:
        """Take over the fields of an equal scene, or allocate them."""
        parts, scene = count_parts(self.features.serial), (self.grid, self.bodies, self.colliders, self.walls)
        check_memory(self.grid, tuple(len(body.positions) for body in self.bodies), self.features, parts)
        self.take_over(scene_key(*scene, self.features, parts), self.precision)
        if "fields" not in self.assembly.shared:
            for collider in self.colliders:
                collider.sdf.lay_out()
        fields = self.assembly.share("fields", lambda: allocate_fields(*scene, self.features, parts))
        self.colliders = [replace(given, sdf=ready.sdf) for given, ready in zip(self.colliders, fields.colliders)]
        self.dtype = fields.dtype

    def _make_stepper(self) -> None:
        """Compile kernels for the scene and what is attached to it, at their first launch."""
        # where contact moves colliders, the launch itself copies the state
        checkpoint, undo = self.rollback.allocate() if self.features.mobile else [], self.rollback.allocate(UNDO)
        counter, sample = self.counter and self.counter.kernel, self.sample and self.sample.kernel
        # sums of sleepers and the blocks that use them are of one kernel
        self.fields.substep_counter.is_listed &= not self.features.sleep
        self.stepper = self.assembly.share(("stepper", counter, sample),
                                           lambda: make_stepper(self.fields, counter, sample, checkpoint, undo))
        rows = COUNTER_ROWS * MAX_READINGS if self.counter else 0
        self._out = np.zeros((self.fields.rows.count + rows, 6))

    @property
    def transfer_interval(self) -> float:
        """Longest stride [s] with the current materials and colliders."""
        return choose_interval(self.requested_interval, self.bodies, self.colliders, self.bound)

    # scene -----------------------------------------------------------------------------------------------------------
    def set_colliders(self, colliders: list[Collider]) -> None:
        """Replace all colliders, before the first advance; particles are unchanged."""
        if self.steps > 0 or self.counter is not None:
            raise InvalidValue("set_colliders: the scene is fixed by the first advance or an attached counter; "
                               "accepted: colliders that are set before")
        check_colliders(colliders)
        before = self.state()
        self.close()
        self.colliders = list(colliders)
        warn_of_colliders(self.grid, self.bodies, self.colliders)
        self._build()
        for name, fields in self.particles.named_fields().items():
            if name in before:
                self.particles.write(fields, before[name])
        self._momentum = None

    def attach(self, counter: RegionCounter, sample: Sample | None = None) -> None:
        """Attach a counter, evaluated during advances, and a sample, taken at their end; kernels are recompiled."""
        if counter.tenure is not self.tenure or counter.index not in self.features.moving_colliders:
            raise InvalidValue("attach: the counter is of another solver or of other colliders, or its collider cannot "
                               "move; accepted: a RegionCounter of this solver and of a moving collider")
        if sample is not None and sample.tenure is not self.tenure:
            raise InvalidValue("attach: the sample is of another solver; accepted: a Sample of this solver")
        self.counter, self.sample = counter, sample
        self._make_stepper()
        self._per_particle = np.zeros((MAX_READINGS, *counter.per_particle_shape), np.float32)

    def set_body_acceleration(self, accelerations: np.ndarray) -> None:
        """Set accelerations besides gravity [m/s^2] (n_particles, 3); only if the solver was made with some."""
        if not self.features.body_acceleration:
            raise InvalidValue("set_body_acceleration: the solver has none; build it with body_acceleration=(n, 3) or "
                               "zeros")
        values = check_finite("body_acceleration", accelerations, (sum(self.particles.counts), 3))
        self.rollback.store_pending()
        self.particles.write(self.particles.acceleration, values)

    # motion of colliders -------------------------------------------------------------------------------------------
    def set_collider_motion(self, index: int, begin: Pose, *ends: Pose, jump: bool = False) -> None:
        """Move a collider in the next advance by a screw motion from begin to end, or to ends at equal intervals.

        jump: whether it may begin elsewhere than at `collider_pose`; otherwise that is reported (ColliderJumped).
        """
        self.paths.set(index, begin, ends, jump)

    def set_collider_mobility(
        self, index: int, W: np.ndarray, free_twist: np.ndarray, *, twist: np.ndarray | None = None,
        pose: Pose | None = None, centre: np.ndarray | None = None, others: dict[int, np.ndarray] | None = None,
    ) -> None:
        """Set how a mobile collider responds to contact in the next advance, and how it moves without contact.

        W: mobility (6, 6): change of twist (linear, angular) per impulse (same order), in world axes about `centre`,
        symmetric and positive semi-definite. free_twist: twist (6,) at the end of the advance without contact. twist,
        pose: current ones; None: those at the end of the last advance. centre: [m] (3,); None: the frame's origin.
        others: index of a mobile collider -> change (6, 6) of this twist per impulse on it. Raises InvalidValue.
        """
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

    def compile(self) -> None:
        """Compile the kernels now instead of in the first advance; nothing moves."""
        with default_precision(self.precision):
            self._launch(0, self.dt, np.zeros((1, 1, COLUMNS), self.dtype), 0, 1)
            self.stepper.mark(self.fields.substep_counter.take(1))

    # time ----------------------------------------------------------------------------------------------------------
    def advance(self, duration: float, readings: int = 1) -> list[Counts]:
        """Advance by `duration` [s] in equal substeps of at most `dt`.

        Returns the counts of the attached counter after each of `readings` equal intervals; an empty list without one.
        Raises SimulationDiverged in the substep in which a value is not finite or a particle moves more than a cell,
        and ColliderTooFast if a collider would need too many substeps. After any error, and after Ctrl-C, the solver is
        in the state that it was in before.
        """
        check_owner()
        self.check_open()
        if not 0 < duration < math.inf:
            raise InvalidValue(f"advance: duration = {duration} s; accepted: a positive time")
        if not 1 <= readings <= MAX_READINGS:
            raise InvalidValue(f"advance: readings = {readings}; accepted: 1 to {MAX_READINGS}")
        self.rollback.begin()
        try:
            return self._advance(duration, readings)
        except BaseException as error:
            if isinstance(error, SimulationDiverged):
                error.state = self.state()
            self.rollback.undo()
            raise

    def _advance(self, duration: float, readings: int) -> list[Counts]:
        """Advance, see `advance`; an error leaves the solver where it came about."""
        total, table = self.paths.plan(duration, readings, self.dt, self.dtype)
        dt, interval = duration / total, total // readings
        counts: list[Counts] = []
        self.substep = dt
        self.mobility.begin(self.paths.poses, duration)
        self.sums[:] = 0.0
        rows, stamps = self.fields.rows, self.fields.substep_counter
        for first, n in split_launches(total, interval):
            self._out[:] = 0.0
            with default_precision(self.precision):
                if not stamps.is_listed:
                    stamps.restart()
                    self.stepper.mark(stamps.next)
                stamps.is_listed = False  # an interrupted launch leaves no list
                self._launch(n, dt, np.ascontiguousarray(table[:, first : first + n]), first, interval)
                stamps.is_listed = True
            stamps.pass_substeps(n)
            squares, self._fastest, halted, held = self._out[rows.status, :4].tolist()
            done = int(halted) or n
            self.sums += self._out[: rows.count]
            self.steps += done
            self.time += done * dt
            self._momentum = Momentum(*self._out[rows.momentum].reshape(2, 3).copy())
            if halted or not math.isfinite(squares + self.mobility.table.sum()) \
                    or self._fastest * dt > SPEED_LIMIT * self.grid.cell:
                raise diagnostics.describe_divergence(self, dt)
            if held and not self._has_warned_of_held:
                self._has_warned_of_held = True
                diagnostics.warn_of_held(self, stacklevel=4)
            if self.counter is not None:
                taken = range(first // interval, (first + n) // interval)
                counts += self.counter.all_counts(self._out[rows.count :], self._per_particle, taken)
            self.mobility.end(self.paths.poses)
        return counts

    def _launch(self, substeps: int, dt: float, motion: np.ndarray, first: int, interval: int) -> None:
        sampled = self._unsampled if self.sample is None else self.sample.values
        self.stepper.launch(substeps, self.fields.substep_counter.next, dt, motion, self.mobility.table, self._out, first,
                            interval, self._per_particle, sampled,
                            self.rollback.place_of_copy() if substeps else NOWHERE,
                            longest_stride(self.transfer_interval, dt))

    # states ----------------------------------------------------------------------------------------------------------
    def store_checkpoint(self) -> None:
        """Store a copy of the state in the memory of the device, until the next call; much faster than `state`."""
        self.rollback.store()

    def restore_checkpoint(self) -> None:
        """Restore the stored checkpoint, any number of times; raises InvalidValue if there is none."""
        self.rollback.restore()

    def state(self) -> dict[str, np.ndarray]:
        """Return the state, for a bitwise identical continuation; it has no parameters such as gravity."""
        named = self.particles.named_fields()
        arrays = {name: self.particles.read(fields) for name, fields in named.items()}
        poses = np.array([np.concatenate(pose) for pose in self.paths.poses]).reshape(-1, 7)
        holes = {} if self.fields.orifices is None else {"orifices": self.fields.orifices.read()}
        return arrays | {"time": np.array(self.time), "steps": np.array(self.steps), "poses": poses,
                         **self.mobility.save(), **holes}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Load a state of this solver, or of one made from the same scene.

        Raises InvalidValue, and changes nothing, for a state of another scene.
        """
        named, poses = self.particles.named_fields(), self.paths.read_snapshot(state)
        arrays = [self.particles.read_snapshot(state, name) for name in named]
        self.grid.check_inside(arrays[0] + self.grid.origin, "load: ", ROUNDING)
        time, steps = float(read_array(state, "time", ())), int(read_array(state, "steps", ()))
        orifices = self.fields.orifices
        holes = None if orifices is None else orifices.read_snapshot(state)
        self.mobility.restore(state)
        self.rollback.store_pending()
        if orifices is not None and holes is not None:
            orifices.write(holes)
        for fields, values in zip(named.values(), arrays):
            self.particles.write(fields, values)
        self.adopt_state(poses, time, steps)

    def adopt_state(self, poses: list[Pose], time: float, steps: int, momentum: Momentum | None = None) -> None:
        """Take over a state that a kernel wrote to the fields: poses, time [s], substeps, momentum if known."""
        self.time, self.steps, self.paths.poses, self._fastest = time, steps, poses, None
        self.paths.pending.clear()
        self._momentum = momentum
        self.fields.substep_counter.is_listed = False
