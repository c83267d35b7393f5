"""Differentiable rollouts: the loss of a tool's motion, and its gradient."""

import contextlib
import math
import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np

from mpm.backend import allocating, default_precision, free_later
from mpm.errors import GradientDiverged, InvalidValue
from mpm.geometry.rigid_motion import COLUMNS, Pose
from mpm.materials.stable_step import accepted_bound, check_step, travel_bound
from mpm.observers.diagnostics import describe_divergence
from mpm.rollout import tool_twists
from mpm.rollout.gradients import Gradients, material_gradients
from mpm.rollout.kernel import AdjointKernel
from mpm.rollout.losses import Loss, LossGradient, RolloutStates
from mpm.rollout.phases import check_differentiable
from mpm.rollout.schedule import RolloutOptions, Schedule, plan_schedule
from mpm.scene.body import largest_volume
from mpm.scene.validation import read_real
from mpm.state.packs import LANES
from mpm.state.particles import SPEED_LIMIT
from mpm.stepping.core import Core
from mpm.stepping.snapshots import StateBank
from mpm.stepping.stride import MAX_SUBSTEPS, longest_stride


class Rollout:
    """Simulation over `n_steps` steps from the solver's current state, with gradients.

    The tool is the only moving collider, if there is one; its twist is constant in each step. options: the fields of
    `RolloutOptions`, such as `step_dt` [s].

    The length of strides is constant in the gradient. A rollout compiles its kernels: make one and call
    `restart`; `close` frees its memory. Raises InvalidValue for a scene or an argument that is not accepted."""

    def __init__(self, solver: Any, n_steps: int, **options: Any) -> None:
        core: Core = solver.core
        check_differentiable(core)
        if n_steps != int(n_steps) or n_steps < 1:
            raise InvalidValue(f"Rollout: n_steps = {n_steps}; accepted: a whole number, 1 or more")
        given = RolloutOptions(**options)
        step_dt = given.step_dt
        self.solver, self._core, self.n_steps = solver, core, int(n_steps)
        self.step_dt, self.window = float(step_dt), given.window
        self.substeps = given.substeps or max(1, math.ceil(step_dt / core.dt - 1e-9))
        longest_dt = min(accepted_bound(core.scene.grid.cell, body.material, largest_volume(core.scene.bodies))
                         for body in core.scene.bodies)
        if self.step_dt / self.substeps > longest_dt:
            raise InvalidValue(f"Rollout: {self.substeps} substeps of a step of {step_dt} s; accepted: "
                               f"{math.ceil(step_dt / longest_dt)} or more")
        states, count = core.fields.particles.state_fields, core.fields.particles.pack_count
        size = StateBank.bytes_per_state(states, core.precision)
        self.schedule: Schedule = plan_schedule(self.n_steps, self.substeps, size, given.budget,
                                                int(core.features.strides))
        with default_precision(core.precision), allocating() as group:
            self._history = StateBank(states, count, self.schedule.slots)
            self._checkpoints = StateBank(states, count, self.schedule.checkpoints)
            longest = min(longest_stride(core.transfer_interval, self.step_dt / self.substeps), self.substeps)
            depth = longest if core.features.strides else 1
            self._kernel = AdjointKernel(core.fields, self._history, depth=depth, materials=given.materials,
                                         limit=given.limit, soft=given.soft, svd=given.svd)
            self._bars = StateBank(self._kernel.state_bars, count, 1)
        self._group = group
        self._free = weakref.finalize(self, free_later, group)
        self._free.atexit = False
        self._tool = core.features.moving_colliders[0] if core.features.moving_colliders else None
        self.forward_steps = 0
        """Steps simulated by the last call: n_steps, and those repeated for the gradient."""
        self.last: Gradients | None = None
        self.restart()

    def close(self) -> None:
        """Give the memory of the stored states back; the rollout is of no more use."""
        self._free.detach()
        self._group.free()

    def restart(self) -> None:
        """Set the start of the rollout to the solver's current state."""
        self.start = self._core.state()
        self._core.load(self.start)
        with default_precision(self._core.precision):
            self._checkpoints.store_now(0)

    # the public pair -------------------------------------------------------------------------------------------------
    def value(self, linear: np.ndarray | None, angular: np.ndarray | None, loss: Loss) -> float:
        """Return the loss of the rollout for a motion of the tool.
        linear [m/s], angular [rad/s]: twist of the tool in each step, in world axes, (n_steps, 3); None without a tool.
        Afterwards the solver is at the end of the rollout, after an error at its start. Raises SimulationDiverged."""
        self._set_twists(linear, angular)
        total = 0.0
        with self._restoring_start():
            self._start_from(0)
            for begin, end in self._pieces(0, self.n_steps):
                self._forward(begin, end)
                total += self._evaluate(begin, end, loss).value
                self._continue_from(end - begin)
            self._core.load(self._end())
        return total

    def value_and_grad(self, linear: np.ndarray | None, angular: np.ndarray | None,
                       loss: Loss) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
        """Return the loss and its derivatives with respect to linear and angular, (n_steps, 3) each.
        `last` has the other derivatives. Afterwards the solver is as after `value`. Raises SimulationDiverged, and
        GradientDiverged if a derivative is not finite."""
        self._set_twists(linear, angular)
        self._loss = loss
        self._kernel.bars.packs.clear()
        self._kernel.parameter_bars.fill(0.0)
        self._total = 0.0
        self._table_bar = np.zeros((self.n_steps, self.substeps, COLUMNS))
        self._pose_bar = np.zeros((self.n_steps, 6))
        self._norms = np.zeros((self.n_steps, 3))
        self._end_state: dict[str, np.ndarray] | None = None
        with self._restoring_start():
            try:
                self._differentiate(0, self.n_steps, 0, 0)
            except GradientDiverged as error:
                error.norms = self._norms[:, :2]
                raise
            assert self._end_state is not None
            self._core.load(self._end_state)
        gradient = tool_twists.differentiate_twists(self._path, self._linear, self._angular, self.step_dt,
                                                    self._table_bar, self._pose_bar)
        materials = material_gradients(self._core.scene.bodies, self._kernel)
        self.last = Gradients(self._total, gradient, materials, self._norms[:, :2])
        return self._total, (gradient.linear, gradient.angular)

    @contextlib.contextmanager
    def _restoring_start(self) -> Iterator[None]:
        """Return the solver to the start where the body of the `with` fails."""
        try:
            yield
        except BaseException:
            self._core.load(self.start)
            raise

    # forwards --------------------------------------------------------------------------------------------------------
    def _set_twists(self, linear: np.ndarray | None, angular: np.ndarray | None) -> None:
        """Check the twists, and plan the tool's motion."""
        shape = (self.n_steps, 3)
        arrays = [np.zeros(shape) if a is None else read_real(f"Rollout: {name}", a, f"real numbers, shape {shape}")
                  for name, a in (("linear", linear), ("angular", angular))]
        for name, array in zip(("linear", "angular"), arrays):
            if array.shape != shape:
                raise InvalidValue(f"Rollout: {name} has shape {array.shape}; accepted: {shape}")
            if not np.isfinite(array).all():
                step, axis = np.argwhere(~np.isfinite(array))[0]
                raise InvalidValue(f"Rollout: {name}[{step}, {axis}] = {array[step, axis]}; accepted: finite numbers")
            if self._tool is None and array.any():
                raise InvalidValue(f"Rollout: {name} moves a tool, and the scene has none; accepted: None")
        check_step(self.step_dt / self.substeps, self._core.scene.grid.cell,
                   [body.material for body in self._core.scene.bodies], "of the materials now",
                   largest_volume(self._core.scene.bodies))
        self._linear, self._angular = arrays
        start = Pose.identity()
        if self._tool is not None:
            row = self.start["poses"][self._tool]
            start = Pose(row[:3], row[3:])
            radius = self._core.scene.colliders[self._tool].sdf.radius
            speeds = np.linalg.norm(arrays[0], axis=1) + radius * np.linalg.norm(arrays[1], axis=1)
            longest = travel_bound(self._core.scene.grid.cell, float(speeds.max()))
            if self.step_dt / self.substeps > longest * (1 + 1e-9):
                raise InvalidValue(f"Rollout: a tool at {speeds.max():.3g} m/s needs "
                                   f"{math.ceil(self.step_dt / longest)} substeps a step; give substeps= that many, "
                                   f"now {self.substeps}")
        self._path = tool_twists.integrate_twists(start, *arrays, self.step_dt)
        table = tool_twists.motion_rows(self._path.positions[:-1], self._path.matrices[:-1],
                                        *(self.step_dt * array for array in arrays), self.step_dt, self.substeps)
        self._table = table.astype(self._core.dtype)
        self.forward_steps = 0

    def _pieces(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Split steps begin .. end - 1 into runs that fit into the history."""
        chunk = self.schedule.chunk
        return [(b, min(b + chunk, end)) for b in range(begin, end, chunk)]

    def _start_from(self, checkpoint: int) -> None:
        """Copy a checkpoint to the history's first slot; 0 is the start."""
        with default_precision(self._core.precision):
            self._history.copy_from(self._checkpoints, checkpoint, 0)

    def _continue_from(self, steps: int) -> None:
        """Copy the state after so many steps to the first slot."""
        with default_precision(self._core.precision):
            self._history.copy_from(self._history, steps * self.substeps, 0)

    def _forward(self, begin: int, end: int) -> None:
        """Run steps from the state in slot 0; every state is stored in the slot after."""
        empty, dt = np.zeros((1, 6, 1, LANES), self._core.dtype), self.step_dt / self.substeps
        for first, last in self._split_launches(begin, end):
            n = (last - first) * self.substeps
            motion = self._table[first:last].reshape(-1, COLUMNS)
            out = self._launch(1, (first - begin) * self.substeps, n, motion, empty, np.zeros((1, COLUMNS)),
                               np.zeros((1, 3)))
            squares, fastest = out[self._core.fields.rows.status, :2]
            if not math.isfinite(squares) or fastest * dt > SPEED_LIMIT * self._core.scene.grid.cell:
                progress = self._core.progress
                progress.time = float(self.start["time"]) + last * self.step_dt
                progress.steps = int(self.start["steps"]) + last * self.substeps
                raise describe_divergence(self._core.readings, dt)
        self.forward_steps += end - begin

    def _split_launches(self, begin: int, end: int) -> list[tuple[int, int]]:
        """Split steps begin .. end - 1 into launches short enough for Ctrl-C and the checks to come in time."""
        length = max(1, MAX_SUBSTEPS // self.substeps)
        return [(first, min(first + length, end)) for first in range(begin, end, length)]

    def _launch(self, forward: int, first: int, n: int, motion: np.ndarray, loss_bar: np.ndarray,
                motion_bar: np.ndarray, norms: np.ndarray) -> np.ndarray:
        fields = self._core.fields
        out, stamp = np.zeros((fields.rows.count, 6)), fields.substep_counter.take(2 * n + 2)
        with default_precision(self._core.precision):
            self._kernel.run(forward, first, n, self.substeps, stamp, self.step_dt / self.substeps,
                            np.ascontiguousarray(motion[None]), loss_bar, motion_bar, norms, np.zeros((1, 1)), out)
        return out

    def _evaluate(self, begin: int, end: int, loss: Loss) -> LossGradient:
        """Evaluate the loss over steps whose states lie in the history."""
        particles, n = self._core.fields.particles, end - begin
        packed = np.zeros((n, 6, particles.n_packs, LANES), self._core.dtype)
        with default_precision(self._core.precision):
            self._kernel.read(self.substeps, packed)
        states = packed.reshape(n, 6, -1)[:, :, particles.index].swapaxes(1, 2).astype(float)
        positions = states[..., :3] + self._core.scene.grid.origin
        bars = loss(RolloutStates(np.arange(begin + 1, end + 1), positions, states[..., 3:],
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
        """Return the solver's state at the end of the rollout, which its fields hold."""
        particles = self._core.fields.particles
        poses = self.start["poses"].copy()
        if self._tool is not None:
            poses[self._tool] = np.concatenate(self._path.pose(self.n_steps))
        named = {name: particles.read(fields) for name, fields in particles.named_fields().items()}
        return self.start | named | {"poses": poses, "time": self.start["time"] + self.n_steps * self.step_dt,
                                     "steps": self.start["steps"] + self.n_steps * self.substeps}

    # backwards -------------------------------------------------------------------------------------------------------
    def _differentiate(self, begin: int, end: int, level: int, slot: int) -> None:
        """Differentiate steps begin .. end - 1, whose first state is the checkpoint in `slot`.
        The adjoints hold the derivatives by the state after them."""
        plan = self.schedule
        if level == plan.levels:
            self._start_from(slot)
            self._forward(begin, end)
            if end == self.n_steps:
                self._end_state = self._end()
            self._reverse(begin, end)
            return
        part = -(-(end - begin) // plan.parts)
        cuts = [*range(begin, end, part), end]
        places = [slot] + [1 + level * (plan.parts - 1) + i for i in range(len(cuts) - 2)]
        self._start_from(slot)
        for k in range(len(cuts) - 2):  # the last part is run when it is differentiated
            for b, e in self._pieces(cuts[k], cuts[k + 1]):
                self._forward(b, e)
                self._continue_from(e - b)
            with default_precision(self._core.precision):
                self._checkpoints.copy_from(self._history, 0, places[k + 1])
        for k in reversed(range(len(cuts) - 1)):
            self._differentiate(cuts[k], cuts[k + 1], level + 1, places[k])

    def _reverse(self, begin: int, end: int) -> None:
        """Turn the adjoints after steps begin .. end - 1 into those before; the history holds their states."""
        bars = self._evaluate(begin, end, self._loss)
        self._total += bars.value
        if bars.pose is not None:
            self._pose_bar[begin:end] = bars.pose
        window, packed = self.window or self.n_steps, self._pack(bars, end - begin)
        last = end
        while last > begin:
            first = max(begin, (last - 1) // window * window)
            if last % window == 0 and last < self.n_steps:
                self._kernel.bars.packs.clear()
            self._reverse_launch(begin, first, last, packed)
            last = first

    def _reverse_launch(self, begin: int, first: int, last: int, loss_bar: np.ndarray) -> None:
        """Reverse steps first .. last - 1, where `begin` is the step of slot 0."""
        for b, e in reversed(self._split_launches(first, last)):
            n = (e - b) * self.substeps
            motion_bar, norms = np.zeros((n, COLUMNS)), np.zeros((e - begin, 3))
            with default_precision(self._core.precision):
                self._bars.store_now(0)
            self._launch(0, (b - begin) * self.substeps, n, self._table[b:e].reshape(-1, COLUMNS), loss_bar, motion_bar,
                         norms)
            if not np.isfinite(norms).all() or not np.isfinite(motion_bar).all():
                raise self._locate(begin, b, e, loss_bar)
            self._table_bar[b:e] = motion_bar.reshape(e - b, self.substeps, COLUMNS)
            self._norms[b:e] = norms[b - begin :]

    def _pack(self, bars: LossGradient, steps: int) -> np.ndarray:
        """Return the loss's adjoints of positions and velocities in packs (steps, 6, packs, LANES)."""
        particles = self._core.fields.particles
        packed = np.zeros((steps, 6, particles.n_lanes), self._core.dtype)
        for first, array in ((0, bars.x), (3, bars.v)):
            if array is not None:
                packed[:, first : first + 3, particles.index] = np.swapaxes(array, 1, 2)
        return packed.reshape(steps, 6, particles.n_packs, LANES)

    def _locate(self, begin: int, first: int, last: int, loss_bar: np.ndarray) -> GradientDiverged:
        """Reverse stride by stride until something is not finite; return what, and at the start of which stride."""
        with default_precision(self._core.precision):
            self._bars.restore_now(0)
        rows, particles = self._table.reshape(-1, COLUMNS), self._core.fields.particles
        quantity, particle, end = "the tool's motion", -1, last * self.substeps
        begins = self._kernel.begin.to_numpy()
        while end > first * self.substeps:  # back by a stride
            slot = int(begins[end - 1 - begin * self.substeps])
            n = end - begin * self.substeps - slot
            motion_bar = np.zeros((n, COLUMNS))
            self._launch(0, slot, n, rows[end - n : end], loss_bar, motion_bar, np.zeros((last - begin, 3)))
            end -= n
            bars = self._kernel.bars
            bad = {name: np.flatnonzero(~np.isfinite(particles.unpack(bars.packs.read(fields))).all(1))
                   for name, fields in bars.named_fields().items()}
            first_bad = [(name, int(indices[0])) for name, indices in bad.items() if len(indices)]
            if first_bad:
                quantity, particle = first_bad[0]
            if first_bad or not np.isfinite(motion_bar).all():
                break
        return GradientDiverged(step=end // self.substeps, substep=end % self.substeps, quantity=quantity,
                                particle=particle)
