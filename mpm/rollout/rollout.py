"""Roll-outs that know how their loss answers to the tool's motion."""

import contextlib
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from mpm.adjoint.kernel import Sweep
from mpm.backend import allocating, default_precision
from mpm.errors import GradientDiverged, InvalidValue, TimeStepTooLarge
from mpm.geometry.rigid_motion import Pose
from mpm.materials.stable_step import material_bound, travel_bound
from mpm.observers.diagnostics import divergence_of
from mpm.rollout import tool_twists as twists
from mpm.rollout.differentiable import check_scene
from mpm.rollout.losses import Loss, LossBars, Seen
from mpm.rollout.material_gradients import material_bars
from mpm.rollout.schedule import Schedule, planned
from mpm.state.history import History
from mpm.state.packs import LANES, Snapshot
from mpm.stepping.stride import MAX_SUBSTEPS, most_substeps
from mpm.stepping.substep import SPEED_LIMIT

BUDGET = 1_000_000_000
"""Bytes that a roll-out's states may take."""


class Gradients(NamedTuple):
    """All that the last `value_and_grad` found."""

    value: float
    twists: twists.TwistBars
    """By the twists, and by the start's position and orientation."""
    materials: list[dict[str, float]]
    """By each body's numbers, such as {"E": ..., "friction_angle_deg": ...}; empty without `materials`."""
    norms: np.ndarray
    """Norms of the derivatives by positions [1/m] and velocities [s/m] of all grains before each step (n_steps, 2)."""


class Rollout:
    """The solver's future over `n_steps` steps of `step_dt` [s] from its present state, in each of which the tool (its
    only moving collider, if it has one) holds a twist: the physics of `Solver.advance`.

    budget: bytes that the kept states may take; `schedule` says what came of it. materials: derivatives by the laws'
    numbers, too. limit: entries of the state's derivatives are cut to plus or minus this in every substep, against the
    growth of sand's. window: at every so-manieth step the state's derivatives are dropped; what the tool's later places
    owe to its earlier twists stays. soft: relative width over which derivatives take the yield surface for smooth; 0:
    it is sharp, as in the motion itself. svd: the derivative of the logarithm of strain as autodiff through a singular
    value decomposition has it, to see what is lost. substeps: per step, or None: as many as the solver's dt asks for.

    Strides are those of the solver, at most as long as its materials allow now; where rounding or a small change of the
    motion would make one longer or shorter, the derivative does not see it. Nodes are kept for every substep of one
    stride, besides the budget.

    Its fields stay until the process ends: make one, and `restart` it.
    """

    def __init__(self, solver, n_steps: int, *, step_dt: float = 2e-3, budget: int = BUDGET,  # noqa: ANN001
                 materials: bool = False, limit: float | None = None, window: int | None = None,
                 soft: float = 0.0, svd: bool = False, substeps: int | None = None) -> None:
        check_scene(solver)
        if n_steps != int(n_steps) or n_steps < 1:
            raise InvalidValue(f"Rollout: n_steps = {n_steps}; accepted: a whole number, 1 or more")
        if not step_dt > 0 or not math.isfinite(step_dt):
            raise InvalidValue(f"Rollout: step_dt = {step_dt} s; accepted: a positive time")
        if substeps is not None and (substeps != int(substeps) or substeps < 1):
            raise InvalidValue(f"Rollout: substeps = {substeps}; accepted: a whole number, 1 or more, or None")
        if window is not None and window < 1:
            raise InvalidValue(f"Rollout: window = {window} steps; accepted: 1 or more, or None")
        if limit is not None and not limit > 0:
            raise InvalidValue(f"Rollout: limit = {limit}; accepted: a positive number, or None")
        if not 0 <= soft < math.inf:
            raise InvalidValue(f"Rollout: soft = {soft}; accepted: 0 or more")
        self.solver, self.n_steps, self.step_dt, self.window = solver, int(n_steps), float(step_dt), window
        self.substeps = substeps or max(1, math.ceil(step_dt / solver.dt - 1e-9))
        if self.step_dt / self.substeps > solver.bound:
            raise InvalidValue(f"Rollout: {self.substeps} substeps of a step of {step_dt} s; accepted: "
                               f"{math.ceil(step_dt / solver.bound)} or more")
        size = History.bytes_per_state(solver.particles, solver.precision)
        self.schedule: Schedule = planned(self.n_steps, self.substeps, size, budget)
        with default_precision(solver.precision), allocating():
            self._history = History(solver.particles, solver.precision, self.schedule.slots)
            self._checkpoints = History(solver.particles, solver.precision, self.schedule.checkpoints)
            longest = min(most_substeps(solver.transfer_interval, self.step_dt / self.substeps), self.substeps)
            depth = longest if solver.features.strides else 1
            self._sweep = Sweep(solver, self._history, depth=depth, materials=materials, limit=limit, soft=soft,
                                svd=svd)
            self._bars = Snapshot(self._sweep.bars.packs)
        self._tool = solver.features.moving_solids[0] if solver.features.moving_solids else None
        self.forward_steps = 0
        """Steps run forwards by the last call: n_steps, and what was run again."""
        self.last: Gradients | None = None
        self.restart()

    def restart(self) -> None:
        """Begin at the solver's present state from now on."""
        self.start = self.solver.state()
        self.solver.load(self.start)
        with default_precision(self.solver.precision):
            self._checkpoints.keep(0)

    # the public pair -------------------------------------------------------------------------------------------------
    def value(self, linear: np.ndarray | None, angular: np.ndarray | None, loss: Loss) -> float:
        """Loss of the roll-out with the tool's velocities linear [m/s], angular [rad/s], (n_steps, 3) each, in world
        axes, or None without a tool. Leaves the solver at the end, or after an error at the start. Raises
        SimulationDiverged."""
        self._set(linear, angular)
        total = 0.0
        with self._or_return():
            self._begin_at(0)
            for begin, end in self._pieces(0, self.n_steps):
                self._forward(begin, end)
                total += self._look(begin, end, loss).value
                self._go_on(end - begin)
            self.solver.load(self._end())
        return total

    def value_and_grad(self, linear: np.ndarray | None, angular: np.ndarray | None,
                       loss: Loss) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Loss, and its derivatives by linear and angular (n_steps, 3); `last` holds those by all else.

        Leaves the solver at the end, or after an error at the start. Raises SimulationDiverged, and GradientDiverged
        where a derivative is not finite.
        """
        self._set(linear, angular)
        self._loss = loss
        self._sweep.bars.clear()
        self._sweep.numbers_bar.fill(0.0)
        self._total = 0.0
        self._table_bar = np.zeros((self.n_steps, self.substeps, 18))
        self._pose_bar = np.zeros((self.n_steps, 6))
        self._norms = np.zeros((self.n_steps, 3))
        self._end_state: dict[str, np.ndarray] | None = None
        with self._or_return():
            try:
                self._back_over(0, self.n_steps, 0, 0)
            except GradientDiverged as error:
                error.norms = self._norms[:, :2]
                raise
            assert self._end_state is not None
            self.solver.load(self._end_state)
        found = twists.back(self._path, self._linear, self._angular, self.step_dt, self._table_bar, self._pose_bar)
        self.last = Gradients(self._total, found, material_bars(self.solver, self._sweep), self._norms[:, :2])
        return self._total, (found.linear, found.angular)

    @contextlib.contextmanager
    def _or_return(self) -> Iterator[None]:
        """Leave the solver at the start where what follows does not come to its end."""
        try:
            yield
        except BaseException:
            self.solver.load(self.start)
            raise

    # forwards --------------------------------------------------------------------------------------------------------
    def _set(self, linear: np.ndarray | None, angular: np.ndarray | None) -> None:
        """Take the twists, and lay out the tool's motion."""
        shape = (self.n_steps, 3)
        given = [np.zeros(shape) if a is None else np.asarray(a, float) for a in (linear, angular)]
        for name, array in zip(("linear", "angular"), given):
            if array.shape != shape:
                raise InvalidValue(f"Rollout: {name} has shape {array.shape}; accepted: {shape}")
            if not np.isfinite(array).all():
                step, axis = np.argwhere(~np.isfinite(array))[0]
                raise InvalidValue(f"Rollout: {name}[{step}, {axis}] = {array[step, axis]}; accepted: finite numbers")
            if self._tool is None and array.any():
                raise InvalidValue(f"Rollout: {name} moves a tool, and the scene has none; accepted: None")
        bound = min(material_bound(self.solver.grid.cell, body.material) for body in self.solver.bodies)
        if self.step_dt / self.substeps > bound:
            raise TimeStepTooLarge(self.step_dt / self.substeps, bound, "of the materials now")
        self._linear, self._angular = given
        start = Pose.identity()
        if self._tool is not None:
            row = self.start["poses"][self._tool]
            start = Pose(row[:3], row[3:])
            radius = self.solver.colliders[self._tool].sdf.radius
            speeds = np.linalg.norm(given[0], axis=1) + radius * np.linalg.norm(given[1], axis=1)
            longest = travel_bound(self.solver.grid.cell, float(speeds.max()))
            if self.step_dt / self.substeps > longest * (1 + 1e-9):
                raise InvalidValue(f"Rollout: a tool at {speeds.max():.3g} m/s needs "
                                   f"{math.ceil(self.step_dt / longest)} substeps a step; give substeps= that many, "
                                   f"now {self.substeps}")
        self._path = twists.path(start, *given, self.step_dt)
        self._table = twists.table(self._path, *given, self.step_dt, self.substeps).astype(self.solver._dtype)
        self.forward_steps = 0

    def _pieces(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Steps begin .. end - 1 in runs that fit into the history."""
        chunk = (self.schedule.slots - 1) // self.substeps
        return [(b, min(b + chunk, end)) for b in range(begin, end, chunk)]

    def _begin_at(self, checkpoint: int) -> None:
        """Put a checkpoint into the history's first slot; 0 is the start."""
        with default_precision(self.solver.precision):
            self._history.copy(self._checkpoints, checkpoint, 0)

    def _go_on(self, steps: int) -> None:
        """Put the state after so many steps into the first slot."""
        with default_precision(self.solver.precision):
            self._history.copy(self._history, steps * self.substeps, 0)

    def _forward(self, begin: int, end: int) -> None:
        """Run steps from the state in slot 0; every state goes into the slot after."""
        empty, dt = np.zeros((1, 6, 1, LANES), self.solver._dtype), self.step_dt / self.substeps
        for first, last in self._launches(begin, end):
            n = (last - first) * self.substeps
            out = self._launch(1, (first - begin) * self.substeps, n, self._table[first:last].reshape(-1, 18), empty,
                               np.zeros((1, 18)), np.zeros((1, 3)))
            squares, fastest = out[self.solver._substeps.status, :2]
            if not math.isfinite(squares) or fastest * dt > SPEED_LIMIT * self.solver.grid.cell:
                self.solver.time = float(self.start["time"]) + last * self.step_dt
                self.solver.steps = int(self.start["steps"]) + last * self.substeps
                raise divergence_of(self.solver, dt)
        self.forward_steps += end - begin

    def _launches(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Steps begin .. end - 1 in launches short enough for Ctrl-C and the checks to come in time."""
        length = max(1, MAX_SUBSTEPS // self.substeps)
        return [(first, min(first + length, end)) for first in range(begin, end, length)]

    def _launch(self, forward: int, first: int, n: int, motion: np.ndarray, loss_bar: np.ndarray,
                motion_bar: np.ndarray, norms: np.ndarray) -> np.ndarray:
        solver = self.solver
        out, stamp = np.zeros((solver._substeps.rows, 6)), solver._stamp + 2
        solver._stamp += 2 * n + 4  # blocks that an advance has listed carry the number after its own
        solver._listed = False
        with default_precision(solver.precision):
            self._sweep.run(forward, first, n, self.substeps, stamp, self.step_dt / self.substeps,
                            np.ascontiguousarray(motion[None]), loss_bar, motion_bar, norms, np.zeros((1, 1)), out)
        return out

    def _look(self, begin: int, end: int, loss: Loss) -> LossBars:
        """The loss over steps whose states lie in the history."""
        particles, n = self.solver.particles, end - begin
        seen = np.zeros((n, 6, particles.n_packs, LANES), self.solver._dtype)
        with default_precision(self.solver.precision):
            self._sweep.read(self.substeps, seen)
        states = seen.reshape(n, 6, -1)[:, :, particles.index].swapaxes(1, 2).astype(float)
        bars = loss(Seen(np.arange(begin + 1, end + 1), states[..., :3] + self.solver.grid.origin, states[..., 3:],
                         self._path.positions[begin + 1 : end + 1], self._path.matrices[begin + 1 : end + 1]))
        for name, array, shape in (("x", bars.x, states[..., :3].shape), ("v", bars.v, states[..., :3].shape),
                                   ("pose", bars.pose, (n, 6))):
            if array is not None and np.shape(array) != shape:
                raise InvalidValue(f"Rollout: the loss's {name} has shape {np.shape(array)}; accepted: {shape}")
            if array is not None and not np.isfinite(array).all():
                step, which = np.argwhere(~np.isfinite(array))[-1][:2]
                raise GradientDiverged(step=begin + int(step), substep=self.substeps - 1, quantity=f"the loss's {name}",
                                       particle=-1 if name == "pose" else int(which))
        return bars

    def _end(self) -> dict[str, np.ndarray]:
        """The solver's state at the end of the roll-out, which its fields hold."""
        solver = self.solver
        poses = self.start["poses"].copy()
        if self._tool is not None:
            poses[self._tool] = np.concatenate(self._path.pose(self.n_steps))
        named = {name: solver.particles.read(fields) for name, fields in solver.particles.named_fields().items()}
        return self.start | named | {
            "poses": poses, "time": self.start["time"] + self.n_steps * self.step_dt,
            "steps": self.start["steps"] + self.n_steps * self.substeps}

    # backwards -------------------------------------------------------------------------------------------------------
    def _back_over(self, begin: int, end: int, level: int, slot: int) -> None:
        """Differentiate steps begin .. end - 1, whose first state is the checkpoint in `slot`; what the loss owes to
        later steps is in the bars."""
        plan = self.schedule
        if level == plan.levels:
            self._begin_at(slot)
            self._forward(begin, end)
            if end == self.n_steps:
                self._end_state = self._end()
            self._back(begin, end)
            return
        part = -(-(end - begin) // plan.parts)
        cuts = [*range(begin, end, part), end]
        places = [slot] + [1 + level * (plan.parts - 1) + i for i in range(len(cuts) - 2)]
        self._begin_at(slot)
        for k in range(len(cuts) - 2):  # the last part is run when it is differentiated
            for b, e in self._pieces(cuts[k], cuts[k + 1]):
                self._forward(b, e)
                self._go_on(e - b)
            with default_precision(self.solver.precision):
                self._checkpoints.copy(self._history, 0, places[k + 1])
        for k in reversed(range(len(cuts) - 1)):
            self._back_over(cuts[k], cuts[k + 1], level + 1, places[k])

    def _back(self, begin: int, end: int) -> None:
        """Bars after steps begin .. end - 1 to bars before them; the history holds their states."""
        bars = self._look(begin, end, self._loss)
        self._total += bars.value
        if bars.pose is not None:
            self._pose_bar[begin:end] = bars.pose
        window, packed = self.window or self.n_steps, self._packed(bars, end - begin)
        last = end
        while last > begin:
            first = max(begin, (last - 1) // window * window)
            if last % window == 0 and last < self.n_steps:
                self._sweep.bars.clear()
            self._back_launch(begin, first, last, packed)
            last = first

    def _back_launch(self, begin: int, first: int, last: int, loss_bar: np.ndarray) -> None:
        """Steps first .. last - 1, where `begin` is the step of slot 0."""
        for b, e in reversed(self._launches(first, last)):
            n = (e - b) * self.substeps
            motion_bar, norms = np.zeros((n, 18)), np.zeros((e - begin, 3))
            with default_precision(self.solver.precision):
                self._bars.keep()
            self._launch(0, (b - begin) * self.substeps, n, self._table[b:e].reshape(-1, 18), loss_bar, motion_bar,
                         norms)
            if not np.isfinite(norms).all() or not np.isfinite(motion_bar).all():
                raise self._located(begin, b, e, loss_bar)
            self._table_bar[b:e] = motion_bar.reshape(e - b, self.substeps, 18)
            self._norms[b:e] = norms[b - begin :]

    def _packed(self, bars: LossBars, steps: int) -> np.ndarray:
        """The loss's bars of positions and velocities in the particles' order (steps, 6, packs, 4)."""
        particles = self.solver.particles
        packed = np.zeros((steps, 6, particles.n_lanes), self.solver._dtype)
        for first, array in ((0, bars.x), (3, bars.v)):
            if array is not None:
                packed[:, first : first + 3, particles.index] = np.swapaxes(array, 1, 2)
        return packed.reshape(steps, 6, particles.n_packs, LANES)

    def _located(self, begin: int, first: int, last: int, loss_bar: np.ndarray) -> GradientDiverged:
        """Go back again until something is not finite, and say what, and at the beginning of which stride."""
        with default_precision(self.solver.precision):
            self._bars.rewind()
        rows, particles = self._table.reshape(-1, 18), self.solver.particles
        quantity, particle, end = "the tool's motion", -1, last * self.substeps
        begins = self._sweep.begin.to_numpy()
        while end > first * self.substeps:  # back by a stride
            slot = int(begins[end - 1 - begin * self.substeps])
            n = end - begin * self.substeps - slot
            motion_bar = np.zeros((n, 18))
            self._launch(0, slot, n, rows[end - n : end], loss_bar, motion_bar, np.zeros((last - begin, 3)))
            end -= n
            bars = self._sweep.bars
            bad = {name: np.flatnonzero(~np.isfinite(particles.in_order(bars.packs.read(fields))).all(1))
                   for name, fields in bars.named_fields().items()}
            found = [(name, int(rows_of[0])) for name, rows_of in bad.items() if len(rows_of)]
            if found:
                quantity, particle = found[0]
            if found or not np.isfinite(motion_bar).all():
                break
        return GradientDiverged(step=end // self.substeps, substep=end % self.substeps, quantity=quantity,
                                particle=particle)
