"""The coupling of a MuJoCo scene and a field of grains."""

from typing import Literal, NamedTuple

import mujoco
import numpy as np

import mpm
from mpm.solver import Momentum
from robosim.errors import ConfigError, RobotDiverged, UnknownName
from robosim.frames import body_pose

COUPLINGS = ("one_way", "lagged")
BAD_STATES = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
Coupling = Literal["one_way", "lagged"]


class Impulse(NamedTuple):
    """Linear [N s] (3,) and angular [N m s] (3,) impulse, the latter about the world's origin."""

    linear: np.ndarray
    angular: np.ndarray


class Ledger(NamedTuple):
    """Who gave momentum to the grains in one step; `residual` is what nobody accounts for."""

    grains: Impulse
    """Change of the grains' momentum."""
    gravity: Impulse
    walls: Impulse
    bodies: dict[str, Impulse]
    """Given by each coupled body; the body received the opposite."""
    static: Impulse
    """Given by colliders that never move."""
    residual: Impulse


class GranularPlugin:
    """Couples named bodies of any MuJoCo model to colliders of a solver, both ways, every step.

    model, data: the MuJoCo scene; the plugin adds to `data.xfrc_applied` and never overwrites it. solver: holds a
    moving collider per coupled body, whose signed distance is given in the body's frame. bodies: body name ->
    index of its collider. coupling: "one_way" moves the colliders and feeds nothing back; "lagged" predicts the bodies'
    motion over the step without this step's grain forces, and applies the impulse that the grains then gave.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver, *,
                 bodies: dict[str, int], coupling: Coupling = "lagged") -> None:
        if coupling not in COUPLINGS:
            raise UnknownName("coupling", coupling, COUPLINGS)
        names = [model.body(i).name for i in range(model.nbody)]
        movable = solver.features.moving_colliders
        for name, collider in bodies.items():
            if name not in names:
                raise UnknownName("body of the MuJoCo model", name, names)
            if collider not in movable:
                raise ConfigError(f"body {name!r}: collider {collider} of the solver cannot move; movable: {movable}")
        if len(set(bodies.values())) != len(bodies):
            raise ConfigError(f"two bodies share a collider: {bodies}")
        self.model, self.data, self.solver, self.coupling = model, data, solver, coupling
        self._bodies = {name: (model.body(name).id, collider) for name, collider in bodies.items()}
        self._scratch = mujoco.MjData(model)
        self._applied = np.zeros((model.nbody, 6))
        """Grain wrenches of the last step: what the next prediction starts from."""
        self.ledger = self._empty_ledger()

    def step(self) -> None:
        """One coupled `mj_step`.

        1. Read where each coupled body is, with positions fresh even after the user changed qpos.
        2. Predict its motion over the step; hand it to the solver as a screw.
        3. Advance the grains; every change of their momentum is credited to somebody.
        4. Apply the impulse to the bodies as a wrench; step MuJoCo.
        5. Close the ledger; raise RobotDiverged when MuJoCo's state went bad.
        """
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        before = self.solver.momentum_after_advance()
        begin = {name: body_pose(self.data, body) for name, (body, _) in self._bodies.items()}
        end = self._predict()
        for name, (_, collider) in self._bodies.items():
            self.solver.set_collider_motion(collider, begin[name], end[name])
        self.solver.advance(self.model.opt.timestep)
        self._apply_and_step()
        self.ledger = self._close_ledger(before)
        self._check_robot()

    def _check_robot(self) -> None:
        """MuJoCo resets a bad state by itself and goes on; only its warning counters tell."""
        bad = [w.name for w in BAD_STATES if self.data.warning[w].number > 0]
        if bad:
            raise RobotDiverged(float(self.data.time), bad)

    def wrench(self, body: str) -> mpm.Wrench:
        """Mean wrench [N], [N m] that the grains put on a body in the last step, about its centre of mass; zero for
        "one_way"."""
        row = self._applied[self._bodies[body][0]]
        return mpm.Wrench(row[:3].copy(), row[3:].copy())

    def _predict(self) -> dict[str, mpm.Pose]:
        """Poses of the bodies after the step, if the grains pushed as in the step before."""
        scratch = self._scratch
        mujoco.mj_copyData(scratch, self.model, self.data)
        scratch.xfrc_applied += self._applied
        mujoco.mj_step(self.model, scratch)
        mujoco.mj_kinematics(self.model, scratch)
        return {name: body_pose(scratch, body) for name, (body, _) in self._bodies.items()}

    def _apply_and_step(self) -> None:
        """Add the grains' wrenches to the user's own for one mj_step, then take them away again."""
        self._applied[:] = 0.0
        if self.coupling != "one_way":
            for body, collider in self._bodies.values():
                impulse = self.solver.collider_impulse(collider, about=self.data.xipos[body])
                self._applied[body] = np.concatenate(impulse) / self.model.opt.timestep
        own = self.data.xfrc_applied.copy()
        self.data.xfrc_applied += self._applied
        mujoco.mj_step(self.model, self.data)
        self.data.xfrc_applied[:] = own
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_comVel(self.model, self.data)

    def _empty_ledger(self) -> Ledger:
        zero = Impulse(np.zeros(3), np.zeros(3))
        return Ledger(zero, zero, zero, dict.fromkeys(self._bodies, zero), zero, zero)

    def _close_ledger(self, before: Momentum) -> Ledger:
        grains = np.concatenate(self.solver.momentum_after_advance()) - np.concatenate(before)
        rows = self.solver.ledger
        given = {name: rows[2 + collider] for name, (_, collider) in self._bodies.items()}
        coupled = {collider for _, collider in self._bodies.values()}
        rest = sum((rows[2 + i] for i in range(len(self.solver.colliders)) if i not in coupled), np.zeros(6))
        residual = grains - rows[0] - rows[1] - rest - sum(given.values(), np.zeros(6))

        def impulse(row: np.ndarray) -> Impulse:
            return Impulse(row[:3].copy(), row[3:].copy())

        return Ledger(impulse(grains), impulse(rows[0]), impulse(rows[1]),
                      {name: impulse(row) for name, row in given.items()}, impulse(rest), impulse(residual))
