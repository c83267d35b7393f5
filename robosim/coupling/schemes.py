"""Coupling schemes: how the motion of the bodies over a step is predicted and corrected."""

import numpy as np

import mpm
from robosim.coupling.coupled_bodies import CoupledBodies
from robosim.coupling.mobility_probe import MobilityProbe
from robosim.coupling.trial_step import TrialStep

NEGLIGIBLE_SPEED = 1e-3
"""[m/s] by which a predicted velocity may be wrong in any case."""


class ExplicitScheme:
    """Prediction of the bodies' motion with known wrenches: of the step before ("lagged"), or none ("one_way")."""

    def __init__(self, trial: TrialStep, solver: mpm.Solver, bodies: CoupledBodies) -> None:
        self._trial, self._solver, self._bodies = trial, solver, bodies
        self.error = np.zeros((len(bodies.dynamic), 6))
        """Twists (B, 6) after the last step less those that the solver found: linear [m/s], angular [rad/s]; zero where
        none are found."""

    def predict(self, wrenches: np.ndarray) -> None:
        """Predict the step under expected wrenches (nbody, 6) of the grains."""
        self._ends = self._trial.predict_poses(wrenches)

    def hand_over(self) -> None:
        """Hand the predicted motion to the solver."""
        for name, end in zip(self._bodies.dynamic, self._ends):
            # MuJoCo's data say where the bodies are, also after a reset
            self._solver.set_collider_motion(self._bodies.colliders[name], self._bodies.pose(name), end, jump=True)

    def park(self) -> None:
        """Leave the bodies' colliders where the bodies are now."""
        for name in self._bodies.dynamic:
            here = self._bodies.pose(name)
            self._solver.set_collider_motion(self._bodies.colliders[name], here, here, jump=True)

    def is_accepted(self, wrenches: np.ndarray) -> bool:
        """Return whether MuJoCo's step under wrenches (nbody, 6) of the grains is as predicted; here always."""
        return True

    def roll_back(self) -> None:
        """Return to the step's start; here no step is repeated."""


class MobilityScheme(ExplicitScheme):
    """Prediction of the bodies' free motion and mobility.
    The solver solves contact and the bodies' motion together. tolerance: share of a body's change of velocity by grains
    by which MuJoCo's step may differ from the solver's solution before the step is repeated; None: never."""

    def __init__(self, trial: TrialStep, solver: mpm.Solver, bodies: CoupledBodies, tolerance: float | None) -> None:
        super().__init__(trial, solver, bodies)
        self._tolerance, self._probe = tolerance, MobilityProbe(trial)

    def predict(self, wrenches: np.ndarray) -> None:
        self._twists, self._free_twists, self._W = self._probe.predict(wrenches)
        self._relaxation: float = 1.0
        self._last_error: np.ndarray | None = None
        if self._tolerance is not None:
            self._solver.store_checkpoint()

    def hand_over(self) -> None:
        bodies = self._bodies
        indices = [bodies.colliders[name] for name in bodies.dynamic]
        W = self._W.reshape(len(indices), 6, len(indices), 6)
        for i, name in enumerate(bodies.dynamic):
            self._solver.set_collider_mobility(
                indices[i], W[i, :, i], self._free_twists[i], twist=self._twists[i], pose=bodies.pose(name),
                centre=self._trial.data.xipos[bodies.ids[name]],
                others={indices[j]: W[i, :, j] for j in range(len(indices)) if j != i})

    def park(self) -> None:
        self.error[:] = 0.0
        for name in self._bodies.dynamic:
            self._solver.set_collider_mobility(self._bodies.colliders[name], np.zeros((6, 6)), np.zeros(6),
                                               twist=np.zeros(6), pose=self._bodies.pose(name))

    def is_accepted(self, wrenches: np.ndarray) -> bool:
        """Measure `error` after MuJoCo's step; compare it with the tolerance.
        Bodies that grains push are first moved to the poses that the solver found."""
        bodies, solver = self._bodies, self._solver
        solved = np.array([np.concatenate(solver.collider_twist(bodies.colliders[name])) for name in bodies.dynamic])
        ends = {i: solver.collider_pose(bodies.colliders[name]) for i, name in enumerate(bodies.dynamic)
                if wrenches[bodies.ids[name]].any()}
        if ends:
            self._probe.correct_poses(ends)
        self.error = self._trial.twists() - solved
        if self._tolerance is None:
            return True
        allowed = NEGLIGIBLE_SPEED + self._tolerance * self._speeds(solved - self._free_twists)
        return not np.any(self._speeds(self.error) > allowed)

    def roll_back(self) -> None:
        """Return to the step's start, with the free twists corrected by the error, under-relaxed by Aitken's rule."""
        if self._last_error is not None:
            change = (self.error - self._last_error).ravel()
            ratio = self._last_error.ravel() @ change / max(change @ change, 1e-300)
            self._relaxation = float(np.clip(-self._relaxation * ratio, 0.1, 1.0))
        self._free_twists, self._last_error = self._free_twists + self._relaxation * self.error, self.error
        self._solver.restore_checkpoint()
        self._trial.roll_back()

    def _speeds(self, twists: np.ndarray) -> np.ndarray:
        """Speed [m/s] (B,) of the fastest point of each body's bounding ball, at most 1 m from its centre."""
        radii = np.array([min(self._solver.colliders[self._bodies.colliders[name]].sdf.radius, 1.0)
                          for name in self._bodies.dynamic])
        return lengths(twists[:, :3]) + radii * lengths(twists[:, 3:])


def lengths(rows: np.ndarray) -> np.ndarray:
    """Return the lengths (n,) of vectors (n, 3), in a third of NumPy's time for a few."""
    return np.sqrt((rows * rows).sum(1))
