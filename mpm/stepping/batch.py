"""Several futures of one scene in one launch: their states lie in a bank and take turns in the solver's fields.

Grid, colliders and kernel are shared, so that one more future costs its grains' state and no more; what a turn adds to
the work is a copy of that state there and back.
"""

from typing import NamedTuple

import numpy as np

from mpm.backend import allocating, default_precision, real_type, ti
from mpm.errors import InvalidValue, SimulationDiverged
from mpm.geometry.rigid_motion import Pose
from mpm.materials.stable_step import material_bound
from mpm.observers.diagnostics import divergence_of
from mpm.observers.tally import MAX_LOOKS, Tallied
from mpm.observers.tally import ROWS as TALLY_ROWS
from mpm.scene.body import Material
from mpm.state.packs import LANES
from mpm.state.parameters import PARAMETERS
from mpm.stepping.collider_paths import Motions
from mpm.stepping.stride import chosen_interval, launches, most_substeps
from mpm.stepping.substep import SPEED_LIMIT, Substeps

LEFT_OUT, READ_ONLY = -1, 0
"""Numbers of substeps that mean something else."""


class Turn(NamedTuple):
    """What a future does in a launch."""

    substeps: int = LEFT_OUT
    first_row: int = 0
    """Of its part of the motion table."""
    interval: int = 1
    """Substeps between two readings."""
    done: int = 0
    """Substeps of the advance in earlier launches."""
    stamp: int = 0
    stay: int = 1
    """The most substeps between two transfers."""


@ti.data_oriented
class BatchSubsteps(Substeps):
    """The kernel of a batch: the substeps of one future after another."""

    def __init__(self, scene, n: int) -> None:  # noqa: ANN001  (a Solver; see Substeps)
        super().__init__(scene)
        self.n = n
        self.kept = [field for named in scene.particles.named_fields().values() for field in named]
        self.bank = ti.Vector.field(LANES, real_type(scene.precision), (n, len(self.kept), scene.particles.n_packs))
        self.flags = ti.field(ti.i8, (n, scene.particles.n_lanes if self.tallies else 1))
        self.rows_of_sample = len(scene.sample.values) if self.samples else 0

    @ti.kernel
    def run_all(self, turns: ti.types.ndarray(), dts: ti.types.ndarray(), motion: ti.types.ndarray(),
                mobile: ti.types.ndarray(), laws: ti.types.ndarray(), out: ti.types.ndarray(),
                results: ti.types.ndarray(), ranks: ti.types.ndarray(), seen: ti.types.ndarray(), looks: ti.i32):
        """Give every future its turn (n, 6); dts [s] (n,), laws (n, bodies, parameters and density); out is zero before
        and after, results (n, rows, 6) hold what it held; ranks (n looks, grains, 2), seen (n grains, 6): as in
        `Substeps.run`, one future after another."""
        ti.loop_config(serialize=True)
        for e in range(self.n):
            substeps, row, interval, done, stamp, stay = [turns[e, i] for i in ti.static(range(6))]
            if substeps != ti.static(LEFT_OUT):
                self.fetch(e)
                self.set_laws(laws, e)
                dt = dts[e]
                if substeps == ti.static(READ_ONLY):
                    if ti.static(self.tallies):
                        self.look(motion, row, 1, 1, out, ranks, e * looks)
                else:
                    self.mark_blocks(self.particles, stamp)
                self.advance(substeps, stamp, dt, motion, row, mobile, out, done, interval, ranks, e * looks, stay)
                self.take_status(out, 0, self.particles.pack_count[None])
                if ti.static(self.samples):
                    self.sample.take(seen, e * ti.static(self.rows_of_sample))
                self.store(e)
                for i in range(results.shape[1]):
                    for j in range(6):
                        results[e, i, j] = out[i, j]
                        out[i, j] = 0.0

    @ti.func
    def fetch(self, e):
        """A future's state into the solver's fields."""
        for i in ti.static(range(len(self.kept))):
            for q in range(self.particles.pack_count[None]):
                self.kept[i][q] = self.bank[e, i, q]
        if ti.static(self.tallies):
            for slot in range(self.flags.shape[1]):
                self.tally.flags[slot] = self.flags[e, slot]

    @ti.func
    def store(self, e):
        """The solver's fields back to where a future's state lies."""
        for i in ti.static(range(len(self.kept))):
            for q in range(self.particles.pack_count[None]):
                self.bank[e, i, q] = self.kept[i][q]
        if ti.static(self.tallies):
            for slot in range(self.flags.shape[1]):
                self.flags[e, slot] = self.tally.flags[slot]

    @ti.func
    def set_laws(self, laws: ti.template(), e):
        """Numbers of a future's materials."""
        for body in ti.static(range(len(self.laws))):
            for i in ti.static(range(PARAMETERS)):
                self.numbers.parameters[body, i] = laws[e, body, i]
            self.numbers.densities[body] = laws[e, body, PARAMETERS]

    @ti.kernel
    def bring(self, e: ti.i32):
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.fetch(e)

    @ti.kernel
    def begin(self, e: ti.i32, state: ti.types.ndarray()):
        """A new state (fields, packs, lanes), in which nothing has been read yet."""
        ti.loop_config(serialize=True)
        for i in range(state.shape[0]):
            for q in range(state.shape[1]):
                for l in ti.static(range(LANES)):
                    self.bank[e, i, q][l] = state[i, q, l]
        ti.loop_config(serialize=True)
        for slot in range(self.flags.shape[1]):
            self.flags[e, slot] = 0


class Batch:
    """n futures of a solver's scene; each has its own grains' state, materials, time and poses of the colliders.

    The solver's attached tally and sample read in every future. The solver itself is left in the state of some future:
    `bring` chooses which. Colliders are moved, not pushed: raises InvalidValue for mobile ones.
    """

    def __init__(self, solver, n: int, looks: int = 1) -> None:  # noqa: ANN001  (a Solver; a cycle otherwise)
        if n < 1 or not 1 <= looks <= MAX_LOOKS:
            raise InvalidValue(f"Batch: n = {n}, looks = {looks}; accepted: 1 or more, 1 to {MAX_LOOKS}")
        if solver.shares is not None:
            raise InvalidValue("Batch: the solver has several threads; accepted: one of mpm.init(threads=1)")
        if solver.features.mobile:
            raise InvalidValue(f"Batch: colliders {solver.features.mobile} are mobile; accepted: moved ones")
        self.solver, self.n, self.looks = solver, n, looks
        with default_precision(solver.precision), allocating():
            self._substeps = BatchSubsteps(solver, n)
        dtype, tally, sample = solver._dtype, solver.tally, solver.sample
        rows = self._substeps.rows + (TALLY_ROWS * looks if tally else 0)
        self._out, self._results = np.zeros((rows, 6)), np.zeros((n, rows, 6))
        self._ranks = np.zeros((n * looks, *(tally.ranks_shape if tally else (1, 2))), np.float32)
        self._seen = np.zeros((n * (len(sample.values) if sample else 1), 6), np.float32)
        self._dts, self._tally = np.zeros(n), tally
        self._materials = [[body.material for body in solver.bodies] for _ in range(n)]
        self._laws = np.zeros((n, len(solver.bodies), PARAMETERS + 1), dtype)
        for e in range(n):
            for body, material in enumerate(self._materials[e]):
                self.set_material(e, body, material)
        self._motions = [Motions(solver.colliders, solver.features, solver.mobility, solver.grid) for _ in range(n)]
        self.time, self.steps = np.zeros(n), np.zeros(n, int)
        """Of every future: [s], substeps."""
        state = solver.state()
        for e in range(n):
            self.load(e, state)

    @property
    def bytes_each(self) -> int:
        """Memory that one more future takes."""
        bank, flags = self._substeps.bank, self._substeps.flags
        size = 8 if self.solver.precision == "f64" else 4
        each = int(np.prod(bank.shape[1:])) * LANES * size + flags.shape[1]
        return each + (self._results.nbytes + self._ranks.nbytes + self._seen.nbytes) // self.n

    def seen(self, e: int) -> np.ndarray:
        """What the solver's sample read in a future when it last had a turn (n, 6)."""
        return self._seen.reshape(self.n, -1, 6)[e]

    def set_material(self, e: int, body: int, material: Material) -> None:
        """As `Solver.set_material`, for one future."""
        self.solver.check_material(body, material)
        self._materials[e][body] = material
        self._laws[e, body] = 0.0
        self._laws[e, body, : len(material.parameters)] = material.parameters
        self._laws[e, body, PARAMETERS] = material.density

    def set_collider_motion(self, e: int, index: int, begin: Pose, *ends: Pose) -> None:
        """As `Solver.set_collider_motion`, for one future."""
        self._motions[e].set(index, begin, ends)

    def collider_pose(self, e: int, index: int) -> Pose:
        """Where a future's last advance left a collider."""
        return self._motions[e].pose(index)

    def load(self, e: int, state: dict[str, np.ndarray]) -> Tallied | None:
        """Put a future into a state (see `Solver.state`); what the tally reads there, where nothing was lost before."""
        particles = self.solver.particles
        packed = [particles.packed(particles.checked(state, name)) for name in particles.named_fields()]
        self._motions[e].poses = self._motions[e].stored_in(state)
        self._motions[e].pending.clear()
        self.time[e], self.steps[e] = float(state["time"]), int(state["steps"])
        with default_precision(self.solver.precision):
            self._substeps.begin(e, np.concatenate(packed))
        self._read(e)
        return self._read(e)  # what is lost at the start is found so, not newly lost

    def _read(self, e: int) -> Tallied | None:
        """What the tally reads in a future as it is."""
        _, table = self._motions[e].take(1.0, 1, np.inf, self.solver._dtype)
        turns = [Turn()] * self.n
        turns[e] = Turn(READ_ONLY)
        self._launch(turns, table)
        return self._tallied(e, range(1))[0] if self._tally else None

    def advance(self, durations: np.ndarray, looks: np.ndarray) -> list[list[Tallied] | SimulationDiverged]:
        """Advance every future by its duration [s] (n,), zero: it rests; what the tally read after each of its `looks`
        (n,) equal intervals, or why the future has ended: `load` begins another."""
        self._check(durations, looks)
        solver, tables, plans, rows = self.solver, [], [Turn()] * self.n, 0
        for e in np.flatnonzero(durations):
            total, table = self._motions[e].take(float(durations[e]), int(looks[e]), solver.dt, solver._dtype)
            self._dts[e] = durations[e] / total
            plans[e] = Turn(total, rows, total // int(looks[e]),
                            stay=most_substeps(self._interval(e), self._dts[e]))
            tables.append(table)
            rows += total
        outcomes: list[list[Tallied] | SimulationDiverged] = [[] for _ in plans]
        pieces = [launches(max(plan.substeps, 0), plan.interval) for plan in plans]
        for k in range(max(map(len, pieces))):
            turns = [Turn() if k >= len(pieces[e]) or not isinstance(outcomes[e], list) else
                     plan._replace(substeps=pieces[e][k][1], first_row=plan.first_row + pieces[e][k][0],
                                   done=pieces[e][k][0]) for e, plan in enumerate(plans)]
            self._launch(turns, np.concatenate(tables, axis=1))
            for e, turn in enumerate(turns):
                if turn.substeps > 0:
                    outcomes[e] = self._outcome(e, turn, outcomes[e])
        return outcomes

    def _interval(self, e: int) -> float:
        """Longest stride [s] of a future's materials."""
        bound = min(material_bound(self.solver.grid.cell, material) for material in self._materials[e])
        return chosen_interval(self.solver.asked_interval, self.solver.bodies, self.solver.colliders, bound)

    def _check(self, durations: np.ndarray, looks: np.ndarray) -> None:
        """Raise InvalidValue for what no future can do, before any begins."""
        for name, given in (("durations", durations), ("looks", looks)):
            if np.shape(given) != (self.n,):
                raise InvalidValue(f"advance: {name} have shape {np.shape(given)}; accepted: ({self.n},)")
        wrong = np.flatnonzero((looks < 1) | (looks > self.looks) | ~(durations >= 0)) if np.any(durations) else []
        for e in wrong:
            if durations[e] != 0:
                raise InvalidValue(f"advance: durations[{e}] = {durations[e]} s, looks[{e}] = {looks[e]}; accepted: 0 "
                                   f"or more, 1 to {self.looks}, the batch's own")

    def _launch(self, turns: list[Turn], motion: np.ndarray) -> None:
        solver = self.solver
        if solver.tally is not self._tally:
            raise InvalidValue("Batch: another tally was attached since the batch was made; make it anew")
        stamped = [turn._replace(stamp=solver.take_stamps(max(turn.substeps, 0) + 1)) for turn in turns]
        with default_precision(solver.precision):
            self._substeps.run_all(np.array(stamped, np.int32), self._dts.astype(solver._dtype),
                                   np.ascontiguousarray(motion), solver.mobility.table, self._laws, self._out,
                                   self._results, self._ranks, self._seen, self.looks)

    def _outcome(self, e: int, turn: Turn, before: list[Tallied]) -> list[Tallied] | SimulationDiverged:
        """What a future's turn came to, with what earlier ones of the advance had read."""
        dt = float(self._dts[e])
        self.time[e] += turn.substeps * dt
        self.steps[e] += turn.substeps
        squares, fastest = self._results[e, self._substeps.status, :2]
        if not np.isfinite(squares) or fastest * dt > SPEED_LIMIT * self.solver.grid.cell:
            self.bring(e)
            return divergence_of(self.solver, dt)
        looks = range(turn.done // turn.interval, (turn.done + turn.substeps) // turn.interval)
        return [*before, *self._tallied(e, looks)] if self._tally else []

    def _tallied(self, e: int, looks: range) -> list[Tallied]:
        begin = self._substeps.rows
        return [self._tally.said(self._results[e, begin + TALLY_ROWS * k : begin + TALLY_ROWS * (k + 1)],
                                 self._ranks[e * self.looks + k]) for k in looks]

    def bring(self, e: int) -> None:
        """Put the solver into a future's state, to be read or drawn."""
        solver = self.solver
        with default_precision(solver.precision):
            self._substeps.bring(e)
        for body, material in enumerate(self._materials[e]):
            solver.set_material(body, material)
        solver.taken_over(list(self._motions[e].poses), float(self.time[e]), int(self.steps[e]))
