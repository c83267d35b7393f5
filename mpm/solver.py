"""The solver: bodies, colliders and walls on one grid, advanced by explicit MLS-MPM."""

import math
from dataclasses import replace

import numpy as np

from mpm.backend import PRECISIONS, allocating, default_precision, real_type, session_precision, ti
from mpm.boundaries.mobile_contact import MobileFields
from mpm.boundaries.mobility_table import MobilityTable
from mpm.boundaries.node_contact import cache_static
from mpm.boundaries.shell_sides import CutFields
from mpm.errors import InvalidValue, TimeStepTooLarge, UnknownName
from mpm.geometry.rigid_motion import Pose, Twist, Wrench
from mpm.geometry.shell import Shell
from mpm.materials.hencky_strain import INTEGRATORS
from mpm.materials.stable_step import chosen_step, material_bound
from mpm.observers import diagnostics
from mpm.observers.diagnostics import Diagnostics, Energy, Momentum
from mpm.observers.readings import Readings
from mpm.observers.sample import Sample
from mpm.observers.tally import MAX_LOOKS, Tallied, Tally
from mpm.observers.tally import ROWS as TALLY_ROWS
from mpm.scene.body import Body, Material
from mpm.scene.collider import Collider
from mpm.scene.features import features_of
from mpm.scene.grid import Grid, GridFields, wrapped
from mpm.scene.validation import check_passage, check_scene, finite, stored
from mpm.scene.walls import Walls
from mpm.state.parameters import Numbers
from mpm.state.particles import ParticleFields
from mpm.stepping.collider_paths import Motions
from mpm.stepping.parallel import Shares, are_shared, substeps_of
from mpm.stepping.rollback import WayBack
from mpm.stepping.stride import Interval, chosen_interval, launches, most_substeps
from mpm.stepping.substep import SPEED_LIMIT


class Solver(Readings):
    """Advances grains; see the package's README for the conventions.

    dt: substep [s], or None for `COURANT_FRACTION` of the bound; a dt above the bound raises TimeStepTooLarge.
    A collider that moves faster than dt allows is followed with smaller substeps. precision: "f32", "f64" or None
    (init's). integrator: "series", "exact", "auto" or None. "auto" takes the eigenvalues for grains whose strain leaves
    the range in which the series is exact to single precision; None is "auto" in single precision, "exact" in double.
    transfer_interval: longest time [s] for which velocities stay on the grid (see `stride`), within an advance and
    between looks; 0: a substep; None and "strides": see `chosen_interval`.
    body_acceleration: (n_particles, 3) [m/s^2], see `set_body_acceleration`.
    """

    def __init__(
        self, *, grid: Grid, bodies: list[Body], colliders: list[Collider] | None = None,
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.81), walls: Walls | None = None,
        dt: float | None = None, precision: str | None = None, integrator: str | None = None,
        body_acceleration: np.ndarray | None = None, transfer_interval: Interval = None,
    ) -> None:
        session = session_precision()
        self.precision = precision or session
        if self.precision not in PRECISIONS:
            raise UnknownName("precision", precision, PRECISIONS)
        takes_logarithms = any(body.material.state == "hencky" for body in bodies)
        integrator = integrator or ("auto" if self.precision == "f32" and takes_logarithms else "exact")
        if integrator not in INTEGRATORS:
            raise UnknownName("integrator", integrator, INTEGRATORS)
        if not bodies:
            raise InvalidValue("Solver: bodies is empty; give at least one Body")
        for body in bodies:
            grid.check_inside(np.asarray(body.positions, float))
        self.grid, self.bodies, self.colliders = grid, list(bodies), list(colliders or [])
        self.walls = walls or Walls()
        self.walls.check(grid)
        self.gravity = finite("Solver: gravity", gravity, (3,))
        check_scene(grid, self.bodies, self.colliders, self.gravity)
        self.bound = min(material_bound(grid.cell, body.material) for body in bodies)
        self.asked_dt, self.asked_interval = dt, transfer_interval
        """What the user asked for, or None."""
        self.dt = chosen_step(dt, self.bound)
        self.time, self.steps, self.substep, self._stamp = 0.0, 0, self.dt, 0
        self.tally: Tally | None = None
        self.sample: Sample | None = None
        self._ranks, self._unseen = np.zeros((1, 1, 2), np.float32), np.zeros((1, 6), np.float32)
        self._integrator, self._accelerated = integrator, body_acceleration is not None
        self._dtype = np.float64 if self.precision == "f64" else np.float32
        self._build()
        if body_acceleration is not None:
            self.set_body_acceleration(body_acceleration)

    def _build(self) -> None:
        """Allocate the fields that the scene asks for and the kernels that read them."""
        self.features = features_of(self.bodies, self.colliders, self.walls, self.precision, self._integrator,
                                    self._accelerated, self.transfer_interval > 0)
        self.mobility = MobilityTable(self.features.mobile)
        self._motions = Motions(self.colliders, self.features, self.mobility, self.grid)
        with default_precision(self.precision), allocating():
            self.particles = ParticleFields(self.bodies, self.grid, self.features)
            self.fields = GridFields(self.grid, self.precision, 2 if self.features.shells else 1,
                                     lists=not are_shared(self.features))
            self.shares = None if self.fields.lists else Shares(self.fields, self.particles.n_packs, self.precision)
            for i, collider in enumerate(self.colliders):
                if isinstance(collider.sdf, Shell):
                    self.colliders[i] = replace(collider, sdf=collider.sdf.baked(self.grid.cell))
                else:
                    collider.sdf.allocate()
            self.cuts = CutFields(self.grid, self.precision, self.particles.n_lanes) if self.features.shells else None
            self.mobiles = None
            if self.features.mobile:
                radii = [self.colliders[i].sdf.radius for i in self.features.mobile]
                self.mobiles = MobileFields([self.fields.nodes_near(radius) for radius in radii], self.precision)
            self.node_contact = self.node_owner = None
            if self.features.static_colliders:
                self.node_contact = ti.Vector.field(4, real_type(self.precision), self.grid.shape)
                self.node_owner = ti.field(ti.i32, self.grid.shape)
            self.numbers = Numbers(self.bodies, self.colliders, self.gravity, self.walls, self.grid, self.precision)
            self._substeps = substeps_of(self)
        with default_precision(self.precision):
            corner, cell = ti.Vector(self.grid.origin, ti.f64), self.grid.cell
            for i in self.features.static_colliders:
                pose = self.colliders[i].pose
                numbers = np.concatenate([pose.position, pose.matrix.ravel()])
                cache_static(self.node_contact, self.node_owner, self.colliders[i].sdf, i, numbers, corner, cell)
        self._out = np.zeros((self._substeps.rows, 6))
        self.ledger = np.zeros((self._substeps.momentum, 6))
        """Impulses of the last advance: gravity, walls, colliders; (linear, angular about the world's origin)."""
        self._momentum = self.momentum()
        self.way_back = WayBack(self)
        self._listed = False  # whether the blocks of the next substep are on the grid's list

    @property
    def transfer_interval(self) -> float:
        """Longest stride [s] with the materials and colliders of now."""
        return chosen_interval(self.asked_interval, self.bodies, self.colliders, self.bound)

    # scene -----------------------------------------------------------------------------------------------------------
    def set_colliders(self, colliders: list[Collider]) -> None:
        """Replace the scene's colliders before the first advance; the grains stay as they are."""
        if self.steps > 0 or self.tally is not None:
            raise InvalidValue("the scene is fixed by the first advance or an attached tally; set its colliders before")
        before = self.state()
        self.colliders = list(colliders)
        for k, collider in enumerate(self.colliders):
            check_passage(self.grid, k, collider)
        self._build()
        for name, fields in self.particles.named_fields().items():
            if name in before:
                self.particles.write(fields, before[name])
        self._momentum = self.momentum()

    def set_gravity(self, gravity: np.ndarray) -> None:
        """Gravity [m/s^2] (3,) from now on."""
        self.gravity = finite("set_gravity", gravity, (3,))
        self.numbers.gravity[None] = self.gravity

    def set_material(self, index: int, material: Material) -> None:
        """Give a body other numbers of its law from now on; raises TimeStepTooLarge where they need a smaller dt."""
        self.check_material(index, material)
        heavier = material.density != self.bodies[index].material.density
        self.bodies[index] = replace(self.bodies[index], material=material)
        self.bound = min(material_bound(self.grid.cell, body.material) for body in self.bodies)
        self.numbers.set_law(index, material)
        self._momentum = self.momentum() if heavier else self._momentum

    def check_material(self, index: int, material: Material) -> None:
        """Raise where a body cannot be given this material."""
        accepted = type(self.bodies[index].material)
        if type(material) is not accepted:
            raise InvalidValue(f"set_material: {type(material).__name__}; accepted: {accepted.__name__}")
        bound = material_bound(self.grid.cell, material)
        if self.dt > bound:
            raise TimeStepTooLarge(self.dt, bound, "isolated particle")

    def attach(self, tally: Tally, sample: Sample | None = None) -> None:
        """Let a tally of this solver read within advances, and a sample at their ends; its kernel is compiled anew."""
        if tally.particles is not self.particles or tally.index not in self.features.moving_colliders:
            raise InvalidValue("attach: the tally is of another solver or of other colliders, or its tool cannot move")
        if sample is not None and sample.particles is not self.particles:
            raise InvalidValue("attach: the sample is of another solver")
        self.tally, self.sample = tally, sample
        self._substeps = substeps_of(self)
        self._out = np.zeros((self._substeps.rows + TALLY_ROWS * MAX_LOOKS, 6))
        self._ranks = np.zeros((MAX_LOOKS, *tally.ranks_shape), np.float32)

    def set_body_acceleration(self, accelerations: np.ndarray) -> None:
        """Accelerations [m/s^2] (n_particles, 3) besides gravity from now on; the solver was built with some."""
        if not self.features.body_acceleration:
            raise InvalidValue("the solver has no body acceleration; build it with body_acceleration=(n, 3) or zeros")
        values = np.asarray(accelerations, float)
        accepted = (sum(self.particles.counts), 3)
        if values.shape != accepted:
            raise InvalidValue(f"body_acceleration has shape {values.shape}; accepted: {accepted}")
        self.way_back.copy_now()
        self.particles.write(self.particles.acceleration, values)

    # motion of colliders -------------------------------------------------------------------------------------------
    def set_collider_motion(self, index: int, begin: Pose, *ends: Pose) -> None:
        """Move a collider along the screw from begin to end during the next advance; several ends are passed at equal
        intervals."""
        self._motions.set(index, begin, ends)

    def set_collider_mobility(
        self, index: int, W: np.ndarray, free_twist: np.ndarray, *, twist: np.ndarray | None = None,
        pose: Pose | None = None, centre: np.ndarray | None = None, others: dict[int, np.ndarray] | None = None,
    ) -> None:
        """How a mobile collider moves during the next advance, if grains touch it and if they do not.

        W: (6, 6) change of its twist (linear, angular) by an impulse (linear, angular) on it, both in world axes about
        its centre, symmetric and positive semi-definite. free_twist: (6,) its twist at the end of the advance if no
        grain touched it. twist: (6,) now, or None: where the last advance ended. pose: of its frame now, or None:
        likewise. centre: [m] (3,) in the world, or None: the frame's origin. others: changes (6, 6) of its twist by
        impulses on other mobile colliders, by their index, where one mechanism holds both.
        """
        if index not in self.features.mobile:
            raise InvalidValue(f"collider {index} is not mobile; mobile: {self.features.mobile}")
        if pose is not None:
            self._motions.poses[index] = pose
        self.mobility.set(index, self._motions.poses[index], W, free_twist, twist, centre, others or {})

    def collider_pose(self, index: int) -> Pose:
        """Where the last advance left a collider."""
        return self._motions.pose(index)

    def collider_twist(self, index: int) -> Twist:
        """Twist of a mobile collider about its centre, where the last advance ended."""
        return self.mobility.twist(index)

    def compile(self) -> None:
        """Compile now what the first advance would; nothing moves."""
        with default_precision(self.precision):
            self._launch(0, self.dt, np.zeros((1, 1, 18), self._dtype), 0, 1)
            self._substeps.mark(self.take_stamps(1))

    # time ----------------------------------------------------------------------------------------------------------
    def advance(self, duration: float, looks: int = 1) -> list[Tallied]:
        """Advance by `duration` [s] in equal substeps of at most `dt`; returns what the attached tally read after each
        of `looks` equal intervals, nothing without one.

        Raises SimulationDiverged when a state is not finite or faster than `SPEED_LIMIT` cells a substep, and
        ColliderTooFast, before anything moves, where no substep could follow a collider.
        """
        if not 0 < duration < math.inf:
            raise InvalidValue(f"advance: duration = {duration} s; accepted: a positive time")
        if not 1 <= looks <= MAX_LOOKS:
            raise InvalidValue(f"advance: looks = {looks}; accepted: 1 to {MAX_LOOKS}")
        total, table = self._motions.take(duration, looks, self.dt, self._dtype)
        dt, interval, read = duration / total, total // looks, []
        self.substep = dt
        self.mobility.begin(self._motions.poses, duration)
        self.ledger[:] = 0.0
        for first, n in launches(total, interval):
            motion = np.ascontiguousarray(table[:, first : first + n])
            self._out[:] = 0.0
            with default_precision(self.precision):
                if not self._listed:
                    self._stamp += 1  # blocks that the last advance listed for its next substep carry the old one
                    self._substeps.mark(self._stamp + 1)
                self._listed = False  # an interrupted launch leaves no list
                self._launch(n, dt, motion, first, interval)
                self._listed = True
            self.ledger += self._out[: self._substeps.momentum]
            if self.tally is not None:
                begin = self._substeps.rows
                for look in range(first // interval, (first + n) // interval):
                    rows = self._out[begin + TALLY_ROWS * look : begin + TALLY_ROWS * (look + 1)]
                    read.append(self.tally.said(rows, self._ranks[look]))
            self.steps += n
            self._stamp = wrapped(self._stamp + n)
            self.time += n * dt
            self._momentum = Momentum(*self._out[self._substeps.momentum].reshape(2, 3).copy())
            squares, fastest = self._out[self._substeps.status, :2]
            if not math.isfinite(squares + self.mobility.table.sum()) or fastest * dt > SPEED_LIMIT * self.grid.cell:
                raise diagnostics.divergence_of(self, dt)
            self.mobility.end(self._motions.poses)
        return read

    def take_stamps(self, count: int) -> int:
        """The first of `count` numbers that no substep has had; blocks are listed under them."""
        self._listed = False
        self._stamp = wrapped(self._stamp + 2)  # blocks that the last advance listed carry the one after its own
        first, self._stamp = self._stamp, wrapped(self._stamp + count - 1)
        return first

    def _launch(self, substeps: int, dt: float, motion: np.ndarray, first: int, interval: int) -> None:
        seen = self._unseen if self.sample is None else self.sample.values
        self._substeps.run(substeps, self._stamp + 1, dt, motion, self.mobility.table, self._out, first, interval,
                           self._ranks, seen, int(self.way_back.due),
                           most_substeps(self.transfer_interval, dt))
        self.way_back.due = self.way_back.due and substeps == 0

    # readings ------------------------------------------------------------------------------------------------------
    def collider_impulse(self, index: int, about: np.ndarray | None = None) -> Wrench:
        """Impulse [N s], [N m s] that the collider received during the last advance, about a point [m] (3,), or None:
        a mobile collider's centre as it moved, another's origin at the end of that advance."""
        here = self._motions.pose(index).position
        if about is None and index in self.features.mobile:
            return self.mobility.impulse(index)
        linear, angular = -self.ledger[self._substeps.first_collider_row + index].reshape(2, 3)
        point = here if about is None else np.asarray(about)
        return Wrench(linear, angular - np.cross(point, linear))

    def momentum_after_advance(self) -> Momentum:
        """Momentum of all grains after the last advance or load, summed in its launch: no copy of the state."""
        return self._momentum

    def momentum(self) -> Momentum:
        """Momentum of all grains, summed in float64."""
        return diagnostics.momentum_of(self)

    def energy(self) -> Energy:
        """Energy of all grains, summed in float64; the elastic part is each law's own."""
        return diagnostics.energy_of(self)

    def diagnostics(self) -> Diagnostics:
        """Mass, momentum, energy, CFL number, compaction, escaped and non-finite grains."""
        return diagnostics.diagnostics_of(self)

    # going back ------------------------------------------------------------------------------------------------------
    def keep(self) -> None:
        """Remember the state until the next `keep`: a copy beside the state, far cheaper than `state`."""
        self.way_back.keep()

    def rewind(self) -> None:
        """Return to the state last kept, any number of times."""
        self.way_back.rewind()

    # snapshots -----------------------------------------------------------------------------------------------------
    def state(self) -> dict[str, np.ndarray]:
        """Everything that the future depends on besides run-time numbers such as gravity, exact to the bit."""
        named = self.particles.named_fields()
        arrays = {name: self.particles.read(fields) for name, fields in named.items()}
        poses = np.array([np.concatenate(pose) for pose in self._motions.poses]).reshape(-1, 7)
        return arrays | {"time": np.array(self.time), "steps": np.array(self.steps), "poses": poses,
                         **self.mobility.kept()}

    def load(self, state: dict[str, np.ndarray]) -> None:
        """Return to a state of this solver or of one built from the same scene; raises InvalidValue, and changes
        nothing, for one of another scene."""
        named, poses = self.particles.named_fields(), self._motions.stored_in(state)
        arrays = [self.particles.checked(state, name) for name in named]
        time, steps = float(stored(state, "time", ())), int(stored(state, "steps", ()))
        self.mobility.restore(state)
        self.way_back.copy_now()
        for fields, values in zip(named.values(), arrays):
            self.particles.write(fields, values)
        self.taken_over(poses, time, steps)

    def taken_over(self, poses: list[Pose], time: float, steps: int, momentum: Momentum | None = None) -> None:
        """The grains' fields hold another state: poses of its colliders, time [s], substeps, momentum if known."""
        self.time, self.steps, self._motions.poses = time, steps, poses
        self._motions.pending.clear()
        self._momentum = self.momentum() if momentum is None else momentum
        self._listed = False
