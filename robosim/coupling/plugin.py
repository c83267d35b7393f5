"""The coupling of a MuJoCo scene and a field of grains."""

import warnings
import weakref
from dataclasses import replace
from itertools import zip_longest
from typing import Literal, get_args

import mujoco
import numpy as np

import mpm
from robosim.coupling.geom_colliders import collider_of
from robosim.coupling.ledger import Impulse, Ledger, close_ledger, empty_ledger
from robosim.coupling.trial_step import Foresight, Twin
from robosim.errors import BodyLeftGrid, ConfigError, RobotDiverged, UnknownName
from robosim.scene.frames import body_pose

__all__ = ["Coupling", "GranularPlugin", "Impulse", "Ledger"]

BAD_STATES = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
Coupling = Literal["one_way", "lagged", "mobility"]
TOLERANCE = 0.1
"""Default share of a body's change of speed by grains by which it may miss what was foreseen."""
NEGLIGIBLE = 1e-3
"""[m/s] by which a body may miss what was foreseen in any case."""
MAX_REPEATS = 4
_coupled: "weakref.WeakValueDictionary[int, GranularPlugin]" = weakref.WeakValueDictionary()
"""Who steps which MjData."""


class GranularPlugin:
    """Couples bodies of any MuJoCo model to colliders of a solver, both ways, every step.

    model, data: the MuJoCo scene. The plugin adds to `data.xfrc_applied` for the step and takes that away again; the
    user's own forces, actuators and callbacks act as ever. bodies: body name -> index of its collider in the solver, in
    the body's frame, or None: made of the body's geoms (see `geoms.collider_of`) before the solver's first advance.

    coupling: "mobility" solves contact and the bodies' motion together in every substep, with the bodies' answer to
    impulses probed from MuJoCo in every step. "lagged" moves the bodies as if the grains pushed as in the step before,
    and applies afterwards what they gave: the usual scheme, here for comparison; light bodies need tiny steps.
    "one_way" moves the colliders and feeds nothing back.

    tolerance: with "mobility", the share of a body's change of speed by grains by which MuJoCo may miss what was
    foreseen (a grasp that slips, a motor at its limit) before the step is taken back and repeated; None: never.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver, *,
                 bodies: dict[str, int | None], coupling: Coupling = "mobility",
                 tolerance: float | None = TOLERANCE) -> None:
        if coupling not in get_args(Coupling):
            raise UnknownName("coupling", coupling, get_args(Coupling))
        if tolerance is not None and not tolerance > 0:
            raise ConfigError(f"tolerance = {tolerance}; accepted: a positive share, or None")
        self.model, self.data, self.solver = model, data, solver
        self.coupling, self.tolerance = coupling, tolerance
        mujoco.mj_kinematics(model, data)
        self._check_names(bodies)
        self._check_clock()
        self._ids = {name: model.body(name).id for name in bodies}
        self._driven = [name for name, body in self._ids.items() if model.body_mocapid[model.body_weldid[body]] >= 0]
        """Mocap bodies and what is fixed to them: moved by the user from step to step, by nothing else."""
        self._colliders, colliders = self._made_colliders(bodies)
        self._moving = [name for name, c in self._colliders.items() if not colliders[c].static]
        self._dynamic = [name for name in self._moving if name not in self._driven]
        for name, c in self._colliders.items():
            self._check_reach(name, colliders[c])
        if any(c is not old for c, old in zip_longest(colliders, solver.colliders)):
            solver.set_colliders(colliders)
        _coupled[id(data)] = self
        self._twin = Twin(model, data, [self._ids[name] for name in self._dynamic])
        self._fresh, self._last_time = True, float(data.time)
        self._applied = np.zeros((model.nbody, 6))
        """Grain wrenches of the last step: what the next prediction starts from."""
        self.outside: set[str] = set()
        """Coupled bodies that are off the solver's grid now."""
        self.miss = np.zeros((len(self._dynamic), 6))
        """Twists (B, 6) after the last step, less those foreseen: linear [m/s], angular [rad/s]; for "mobility"."""
        self.repeats = 0
        """Times that the last step was repeated."""
        self.ledger = empty_ledger(self._colliders)
        self.read: list[mpm.Tallied] = []
        """What the solver's tally, if one is attached, read after the last step."""

    def step(self) -> None:
        """One coupled `mj_step`.

        1. Read where each coupled body is, how it moves and, for "mobility", how it answers to impulses.
        2. Foresee its motion over the step; hand it to the solver.
        3. Advance the grains; every change of their momentum is credited to somebody.
        4. Apply the impulse to the bodies as a wrench; step MuJoCo.
        5. Compare with what was foreseen; repeat the step if it missed.
        6. Close the ledger; raise RobotDiverged when MuJoCo's state went bad, or a body is too fast to be followed.
        """
        self._twin.begin()
        before = self.solver.momentum_after_advance()
        self._move_driven()
        if self.coupling == "mobility" and self._dynamic:
            self._step_together()
        else:
            self._move_as_foreseen()
            self._advance()
            self._apply_and_step()
        self.ledger = close_ledger(self.solver, before, self._colliders)
        self._watch_grid()
        self._check_robot()

    def restart(self) -> None:
        """Forget the last step, after the user put scene and grains into another state."""
        self._fresh, self._applied[:], self.miss[:] = True, 0.0, 0.0
        for bad in BAD_STATES:
            self.data.warning[bad].number = 0
        self.outside, self.ledger = set(), empty_ledger(self._colliders)

    def wrench(self, body: str) -> mpm.Wrench:
        """Mean wrench [N], [N m] that the grains put on a body in the last step, about its centre of mass; zero with
        "one_way" for bodies that MuJoCo moves."""
        if body not in self._colliders:
            raise UnknownName("coupled body", body, self._colliders)
        if body in self._dynamic:
            row = self._applied[self._ids[body]]
            return mpm.Wrench(row[:3].copy(), row[3:].copy())
        impulse = self.solver.collider_impulse(self._colliders[body], about=self.data.xipos[self._ids[body]])
        return mpm.Wrench(impulse.force / self.model.opt.timestep, impulse.torque / self.model.opt.timestep)

    # the step ------------------------------------------------------------------------------------------------------
    def _move_driven(self) -> None:
        restarted = self._fresh or self.data.time < self._last_time  # no way from where it was to where it is
        for name in self._driven:
            now = body_pose(self.data, self._ids[name])
            begin = now if restarted else self.solver.collider_pose(self._colliders[name])
            self.solver.set_collider_motion(self._colliders[name], begin, now)
        self._fresh, self._last_time = False, float(self.data.time)

    def _move_as_foreseen(self) -> None:
        """Hand the solver the motion that the bodies would have if the grains pushed as in the step before."""
        ends = self._twin.poses_after(self._applied)
        for name, end in zip(self._dynamic, ends):
            self.solver.set_collider_motion(self._colliders[name], body_pose(self.data, self._ids[name]), end)

    def _step_together(self) -> None:
        """Advance grains and bodies together; repeat while MuJoCo misses what was foreseen."""
        foresight = self._twin.foresee(self._applied)
        free, weight, last = foresight.free.copy(), 1.0, None
        if self.tolerance is not None:
            self.solver.keep()
        for self.repeats in range(MAX_REPEATS + 1):
            self._hand_over(foresight, free)
            self._advance()
            solved = np.array([np.concatenate(self.solver.collider_twist(self._colliders[n])) for n in self._dynamic])
            self._apply_and_step()
            ends = {i: self.solver.collider_pose(self._colliders[name]) for i, name in enumerate(self._dynamic)
                    if self._applied[self._ids[name]].any()}
            if ends:
                self._twin.bring(ends)
            self.miss = self._twin.twists() - solved
            if self.repeats == MAX_REPEATS or not self._misses(solved - free):
                return
            # the answers were linearised; shift what is foreseen by what was missed (Aitken's relaxation)
            if last is not None:
                change = (self.miss - last).ravel()
                weight = float(np.clip(-weight * (last.ravel() @ change) / max(change @ change, 1e-300), 0.1, 1.0))
            free, last = free + weight * self.miss, self.miss
            self.solver.rewind()
            self._twin.restart()

    def _advance(self) -> None:
        try:
            self.read = self.solver.advance(self.model.opt.timestep)
        except mpm.ColliderTooFast as error:
            raise RobotDiverged(float(self.data.time), [str(error)]) from error

    def _hand_over(self, foresight: Foresight, free: np.ndarray) -> None:
        """Give the solver the bodies' places, velocities and answers to impulses."""
        indices = [self._colliders[name] for name in self._dynamic]
        W = foresight.mobility.reshape(len(indices), 6, len(indices), 6)
        for i, name in enumerate(self._dynamic):
            body = self._ids[name]
            self.solver.set_collider_mobility(
                indices[i], W[i, :, i], free[i], twist=foresight.twists[i], pose=body_pose(self.data, body),
                centre=self.data.xipos[body], others={indices[j]: W[i, :, j] for j in range(len(indices)) if j != i})

    def _misses(self, change: np.ndarray) -> bool:
        """Whether some body's twist is off by more than the tolerance; change: of its twist by grains."""
        if self.tolerance is None:
            return False
        sizes = [min(self.solver.colliders[self._colliders[name]].sdf.radius, 1.0) for name in self._dynamic]

        def speeds(twists: np.ndarray) -> np.ndarray:
            return np.linalg.norm(twists[:, :3], axis=1) + sizes * np.linalg.norm(twists[:, 3:], axis=1)

        return bool(np.any(speeds(self.miss) > NEGLIGIBLE + self.tolerance * speeds(change)))

    def _apply_and_step(self) -> None:
        """Add the grains' wrenches to the user's own for one step, then take them away again."""
        self._applied[:] = 0.0
        if self.coupling != "one_way":
            for name in self._dynamic:
                body = self._ids[name]
                about = None if self.coupling == "mobility" else self.data.xipos[body]
                impulse = self.solver.collider_impulse(self._colliders[name], about=about)
                self._applied[body] = np.concatenate(impulse) / self.model.opt.timestep
        own = self.data.xfrc_applied.copy()
        self.data.xfrc_applied += self._applied
        self._twin.finish()
        self.data.xfrc_applied[:] = own

    # checks --------------------------------------------------------------------------------------------------------
    def _check_names(self, bodies: dict[str, int | None]) -> None:
        """Raise on bodies and colliders that are not there, or not free to be coupled."""
        names = [self.model.body(i).name for i in range(self.model.nbody)]
        for name in bodies:
            if name not in names:
                raise UnknownName("body of the MuJoCo model", name, names)
        given = [c for c in bodies.values() if c is not None]
        if len(set(given)) != len(given):
            raise ConfigError(f"two bodies share a collider: {bodies}")
        movable = self.solver.features.moving_colliders
        for name, collider in bodies.items():
            if collider is not None and collider not in movable:
                raise ConfigError(f"body {name!r}: collider {collider} of the solver cannot move; movable: {movable}")
        if id(self.data) in _coupled:
            raise ConfigError("another plugin steps this MjData already, and each would take a step of its own; give "
                              "all grains to one solver as bodies, and all coupled bodies to one plugin")

    def _made_colliders(self, bodies: dict[str, int | None]) -> tuple[dict[str, int], list[mpm.Collider]]:
        """Index of each body's collider, and the scene's colliders with those that are made of geoms."""
        indices, colliders = {}, list(self.solver.colliders)
        for name, collider in bodies.items():
            if collider is None:
                collider = len(colliders)
                colliders.append(collider_of(self.model, self.data, self._ids[name], self.solver.grid.cell,
                                             apart=frozenset(self._ids.values())))
            mobile = self.coupling == "mobility" and not colliders[collider].static and name not in self._driven
            if colliders[collider].mobile != mobile:
                colliders[collider] = replace(colliders[collider], mobile=mobile)
            indices[name] = collider
        return indices, colliders

    def _check_clock(self) -> None:
        """A substep that the user asked for divides the host step."""
        if self.solver.asked_dt is not None:
            ratio = self.model.opt.timestep / self.solver.asked_dt
            if abs(ratio - round(ratio)) > 1e-6 * ratio:
                raise ConfigError(f"the host step {self.model.opt.timestep} s is {ratio:.6g} substeps of "
                                  f"{self.solver.asked_dt} s; accepted: a whole number, or dt=None for the solver")

    def _off_grid(self, name: str, collider: mpm.Collider) -> bool:
        """Whether a body's ball lies outside the solver's grid."""
        grid, radius, place = self.solver.grid, collider.sdf.radius, self.data.xpos[self._ids[name]]
        upper = np.asarray(grid.lower) + grid.cells * grid.cell
        return bool(np.any(place + radius < grid.lower) or np.any(place - radius > upper))

    def _check_reach(self, name: str, collider: mpm.Collider) -> None:
        if self._off_grid(name, collider):
            raise ConfigError(f"body {name!r} is at {tuple(self.data.xpos[self._ids[name]].round(4))} m, outside the "
                              f"solver's grid {self.solver.grid.lower} .. {self.solver.grid.upper} m; enlarge the "
                              f"grid, or place the body in it")

    def _watch_grid(self) -> None:
        """Tell of bodies that leave the grid; their contact has ended, and begins anew when they return."""
        outside = {name for name in self._moving if self._off_grid(name, self.solver.colliders[self._colliders[name]])}
        for name in outside - self.outside:
            warnings.warn(BodyLeftGrid(f"body {name!r} left the solver's grid at t = {self.data.time:.6g} s; it meets "
                                       f"no grains until it returns"), stacklevel=3)
        self.outside = outside

    def _check_robot(self) -> None:
        """MuJoCo resets a bad state by itself and goes on; only its warning counters tell."""
        bad = [w.name for w in BAD_STATES if self.data.warning[w].number > 0]
        if bad:
            raise RobotDiverged(float(self.data.time), [f"MuJoCo reports {words}" for words in bad])
