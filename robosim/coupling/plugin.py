"""The coupling of a MuJoCo scene and a field of grains."""

import copy
import warnings
import weakref
from typing import TYPE_CHECKING, Any, Literal, get_args

import mujoco
import numpy as np

import mpm
from robosim.base.errors import BodyLeftGrid, ConfigError, RobotDiverged, UnknownName
from robosim.coupling.coupled_bodies import CoupledBodies, check_bodies
from robosim.coupling.ledger import Impulse, Ledger, balance, write_sums
from robosim.coupling.reach import Reach
from robosim.coupling.schemes import ExplicitScheme, MobilityScheme
from robosim.coupling.trial_step import TrialStep

if TYPE_CHECKING:
    from robosim.recordings.live import LiveView

__all__ = ["Coupling", "GranularPlugin", "Impulse", "Ledger"]

Coupling = Literal["one_way", "lagged", "mobility"]
BAD_STATES = {int(kind): kind.name for kind in (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL,
                                               mujoco.mjtWarning.mjWARN_BADQACC)}
TOLERANCE = 0.1
"""Default share of a body's change of velocity by grains by which the prediction may be wrong."""
MAX_REPEATS = 4
"""Repetitions of a step, after which its prediction error is accepted and reported."""
_plugins: "weakref.WeakValueDictionary[int, GranularPlugin]" = weakref.WeakValueDictionary()
"""Id of an MjData -> the plugin that owns it."""


class GranularPlugin:
    """Two-way coupling of bodies of any MuJoCo model to colliders of a solver.

    - model, data: the MuJoCo scene. During a step the plugin adds wrenches to `data.xfrc_applied` and removes them
      afterwards; forces of the user, actuators and callbacks keep their effect.
    - bodies: body name -> index of a collider of the solver, in the frame of the body; None: a collider is made from
      the body's geoms, before the first advance of the solver.
    - coupling: "mobility": contact and motion of the bodies are solved together in every substep, with the mobility of
      the bodies computed by MuJoCo in every step. "lagged": the motion is predicted with the wrenches of the previous
      step, and the new ones are applied afterwards; light bodies need very small steps. "one_way": the bodies move the
      grains, the grains exert no force on them.
    - tolerance: for "mobility". A step is rolled back and repeated if MuJoCo's velocities differ from the prediction by
      more than this fraction of the change of velocity by the grains, as when a grasp slips; None: never repeated.

    Raises UnknownName or ConfigError for bodies, colliders or a time step that cannot be coupled."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver, *,
                 bodies: dict[str, int | None], coupling: Coupling = "mobility",
                 tolerance: float | None = TOLERANCE) -> None:
        if coupling not in get_args(Coupling):
            raise UnknownName("coupling", coupling, get_args(Coupling))
        if tolerance is not None and not tolerance > 0:
            raise ConfigError(f"tolerance = {tolerance}; accepted: a positive share, or None")
        check_bodies(model, solver, bodies)
        if id(data) in _plugins:
            raise ConfigError("another plugin steps this MjData already, and each would take a step of its own; give "
                              "all grains to one solver as bodies, and all coupled bodies to one plugin")
        if solver.numerics.dt is not None:
            ratio = model.opt.timestep / solver.numerics.dt
            if abs(ratio - round(ratio)) > 1e-6 * ratio:
                raise ConfigError(f"the host step {model.opt.timestep} s is {ratio:.6g} substeps of "
                                  f"{solver.numerics.dt} s; accepted: a whole number, or dt=None for the solver")
        self.model, self.data, self.solver = model, data, solver
        self.coupling, self.tolerance = coupling, tolerance
        mujoco.mj_kinematics(model, data)
        self._bodies = CoupledBodies(model, data, solver, bodies, is_mobile=coupling == "mobility")
        _plugins[id(data)] = self
        self.colliders = self._bodies.colliders
        """Name of each coupled body -> index of its collider in the solver."""
        self._trial = TrialStep(model, data, [self._bodies.ids[name] for name in self._bodies.dynamic])
        is_mobile = coupling == "mobility" and self._bodies.dynamic
        self._scheme = (MobilityScheme(self._trial, solver, self._bodies, tolerance) if is_mobile else
                        ExplicitScheme(self._trial, solver, self._bodies))
        self._reach = Reach(self._trial, solver, self._bodies, self._scheme.park)
        self._has_jumped, self._last_time, self._warned = True, float(data.time), data.warning.number
        self._wrenches = np.zeros((model.nbody, 6))
        """Wrenches of the grains in the last step, about the bodies' centres of mass: the next prediction's guess."""
        self.outside_grid: set[str] = set()
        """Coupled bodies that are outside the solver's grid now."""
        self.repeats = 0
        """Number of repetitions of the last step."""
        self.is_missed = False
        """Whether the last step was accepted above the tolerance, because no repetition brought it below."""
        self.sums = np.zeros((len(solver.ledger) + 2, 6))
        """What the last step summed, see `robosim.coupling.ledger.write_sums`; the next one writes it anew."""
        self.counts: list[mpm.Counts] = []
        """Counts of the counter attached to the solver, if any, after the last step."""

    @property
    def ledger(self) -> Ledger:
        """Momentum balance of the last step."""
        return balance(self.sums.copy(), self.colliders)

    @property
    def prediction_error(self) -> np.ndarray:
        """Difference (B, 6) of MuJoCo's twists after the last step from the predicted ones, MuJoCo minus predicted.
        Linear [m/s], angular [rad/s]; one row for each body that is not a mocap body. Zero unless coupling="mobility".
        """
        return self._scheme.error

    def step(self) -> None:
        """Advance robot and grains together by one coupled `mj_step`.

        Where no body is within reach of a grain, steps 2, 4 and 5 are left out; the results are the same.

        1. Evaluate pose and twist of each coupled body at the step's start.
        2. Predict its motion over the step; with "mobility" the free motion and the 6x6 mobility.
        3. Hand the prediction to the solver; advance the grains. With "mobility" contact and body twist are solved
           together in each substep.
        4. Apply the summed impulses as wrenches to the bodies; step MuJoCo.
        5. Compare MuJoCo's twists with the prediction; above the tolerance roll back and repeat.
        6. Close the momentum ledger; check grid and state.

        Raises RobotDiverged where MuJoCo's state is bad or a body is too fast, and the solver's errors. Warns with
        BodyLeftGrid."""
        if self.data.time != self._last_time:  # reset, at a keyframe, or stepped without grains
            self.restart()
        self._trial.begin()
        momentum = self.solver.momentum_after_advance()
        self._move_driven_bodies()
        if self._reach.is_apart():
            self.repeats, self.is_missed = 0, False
            self._wrenches[:] = 0.0
            self._advance_grains()
            self._trial.finish()
        else:
            self._step_together()
        self._last_time = float(self.data.time)
        write_sums(self.solver, momentum, self.sums)
        self._check_grid()
        self._check_state()

    def _step_together(self) -> None:
        """Steps 2 to 5, see `step`."""
        self._scheme.predict(self._wrenches)
        for self.repeats in range(MAX_REPEATS + 1):
            self._scheme.hand_over()
            self._advance_grains()
            self._apply_wrenches_and_step()
            self.is_missed = not self._scheme.is_accepted(self._wrenches)
            if not self.is_missed or self.repeats == MAX_REPEATS:
                break
            self._scheme.roll_back()

    def restart(self) -> None:
        """Forget the last step; call it after `Solver.load`, and after `mj_resetData` to the time of the last step.
        Where MuJoCo's time is another than after the last step, the next one does so by itself."""
        self._has_jumped, self._wrenches[:], self._scheme.error[:] = True, 0.0, 0.0
        self._reach.restart()
        self._warned[list(BAD_STATES)] = 0
        self.outside_grid, self.sums[:] = set(), 0.0

    def state(self) -> dict[str, Any]:
        """Return what the next step depends on besides MuJoCo's integration state and `Solver.state`."""
        return {"wrenches": self._wrenches.copy(), "has_jumped": self._has_jumped, "last_time": self._last_time,
                "error": self._scheme.error.copy(), "repeats": self.repeats, "reach": self._reach.state(),
                "sums": self.sums.copy(), "outside_grid": sorted(self.outside_grid),
                "counts": [copy.deepcopy(c._asdict()) for c in self.counts]}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned; MuJoCo's and the solver's states are loaded before or afterwards."""
        self.restart()
        self._wrenches[:], self._scheme.error[:] = state["wrenches"], state["error"]
        self._has_jumped, self._last_time = state["has_jumped"], state["last_time"]
        self.repeats, self.sums[:], self.outside_grid = state["repeats"], state["sums"], set(state["outside_grid"])
        self._reach.load(state["reach"])
        self.counts = [mpm.Counts(**copy.deepcopy(counts)) for counts in state["counts"]]

    def wrench(self, body: str) -> mpm.Wrench:
        """Return the mean wrench [N], [N m] of the grains on a body in the last step.
        In world axes about the body's centre of mass; with "one_way" zero for bodies that move by joints. Raises
        UnknownName for a body that is not coupled."""
        bodies = self._bodies
        if body not in bodies.colliders:
            raise UnknownName("coupled body", body, bodies.colliders)
        if body in bodies.dynamic:
            row = self._wrenches[bodies.ids[body]]
            return mpm.Wrench(row[:3].copy(), row[3:].copy())
        impulse = self.solver.collider_impulse(bodies.colliders[body], about=self.data.xipos[bodies.ids[body]])
        return mpm.Wrench(impulse.force / self.model.opt.timestep, impulse.torque / self.model.opt.timestep)

    def view(self, **options: Any) -> "LiveView":
        """Show the scene in a browser; call `update` of what is returned after every step, and `close` at the end.
        options: of `robosim.recordings.live.LiveView`, such as port and out. The page is at `address`."""
        from robosim.recordings.live import LiveView

        body = next(iter(self._bodies.colliders), "")
        return LiveView(self.model, self.data, self.solver, tool=body,
                        wrench=(lambda: self.wrench(body)) if body else None, **options)

    def _move_driven_bodies(self) -> None:
        """Hand the motion of mocap bodies since the last step to the solver; after a jump they stand still."""
        for name in self._bodies.driven:
            collider, end = self._bodies.colliders[name], self._bodies.pose(name)
            begin = end if self._has_jumped else self.solver.collider_pose(collider)
            self.solver.set_collider_motion(collider, begin, end, jump=self._has_jumped)
        self._has_jumped = False

    def _advance_grains(self) -> None:
        try:
            self.counts = self.solver.advance(self.model.opt.timestep)
        except mpm.ColliderTooFast as error:
            raise RobotDiverged(float(self.data.time), [str(error)]) from error

    def _apply_wrenches_and_step(self) -> None:
        """Add the grains' wrenches to the user's own for one MuJoCo step, then remove them again."""
        self._wrenches[:] = 0.0
        if self.coupling != "one_way":
            for name in self._bodies.dynamic:
                body = self._bodies.ids[name]
                about = None if self.coupling == "mobility" else self.data.xipos[body]
                impulse = self.solver.collider_impulse(self._bodies.colliders[name], about=about)
                self._wrenches[body] = np.concatenate(impulse) / self.model.opt.timestep
        user_wrenches = self.data.xfrc_applied.copy()
        self.data.xfrc_applied += self._wrenches
        self._trial.finish()
        self.data.xfrc_applied[:] = user_wrenches

    def _check_grid(self) -> None:
        """Warn when bodies leave the grid: their contact ends there, and begins again when they return."""
        outside = self._bodies.find_outside_grid()
        for name in outside - self.outside_grid:
            warnings.warn(BodyLeftGrid(f"body {name!r} left the solver's grid at t = {self.data.time:.6g} s; it has "
                                       f"no contact with grains until it returns"), stacklevel=3)
        self.outside_grid = outside

    def _check_state(self) -> None:
        """Raise RobotDiverged for a bad state; MuJoCo resets one and continues, and only counts a warning."""
        bad = [name for kind, name in BAD_STATES.items() if self._warned[kind] > 0]
        if bad:
            raise RobotDiverged(float(self.data.time), [f"MuJoCo reports {name}" for name in bad])
