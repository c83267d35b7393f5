"""Whether grains and bodies can touch within a step: where they cannot, a step needs neither probe nor prediction."""

from collections.abc import Callable
from typing import Any

import numpy as np

import mpm
from robosim.coupling.coupled_bodies import CoupledBodies
from robosim.coupling.schemes import lengths
from robosim.coupling.trial_step import TrialStep

AHEAD = 2.0
"""How many times as far as at its present speed a body may get within a step."""
SPARE = 1.0
"""Cells of clearance that are kept for speeds that change within a step: 4 m/s in 1 ms and cells of 4 mm."""
RENEWAL = 2.0
"""Cells by which a clearance has to grow before a body counts as out of reach again."""


class Reach:
    """The clearance of the bodies that MuJoCo moves from all grains, measured anew only when it may have been spent.
    A clearance changes by what the body has moved since, which poses tell, and by what the fastest grain has travelled.
    park: leaves the bodies' colliders in the solver where the bodies are, at rest, while none is in reach."""

    def __init__(self, trial: TrialStep, solver: mpm.Solver, bodies: CoupledBodies, park: Callable[[], None]) -> None:
        self._trial, self._solver, self._bodies, self._park = trial, solver, bodies, park
        indices = [bodies.colliders[name] for name in bodies.dynamic]
        self._radii = np.array([solver.colliders[index].sdf.radius for index in indices])
        self._needed = solver.contact_reach + SPARE * solver.grid.cell
        self._renewal = RENEWAL * solver.grid.cell
        self.restart()

    def restart(self) -> None:
        """Measure in the next step."""
        self._gaps, self._poses, self._travel, self._is_apart = np.zeros(0), np.zeros((0, 7)), 0.0, False

    def state(self) -> dict[str, Any]:
        """Return what was measured where, and what grains have travelled since."""
        return {"gaps": self._gaps.copy(), "poses": self._poses.copy(), "travel": self._travel,
                "is_apart": self._is_apart}

    def load(self, state: dict[str, Any]) -> None:
        """Take over what `state` returned."""
        self._gaps, self._poses = state["gaps"].copy(), state["poses"].copy()
        self._travel, self._is_apart = state["travel"], state["is_apart"]

    def is_apart(self) -> bool:
        """Return whether no body that MuJoCo moves can touch grains in the step that begins."""
        names, solver = self._bodies.dynamic, self._solver
        if not names:
            return True
        if solver.counter is not None and any(solver.counter.index == self._bodies.colliders[name] for name in names):
            return False  # its readings are in the frame of a body
        self._travel += self._trial.model.opt.timestep * solver.fastest
        poses = self._bodies.dynamic_poses()
        if self._may_have_changed(poses):
            self._measure(poses)
        return self._is_apart

    def _may_have_changed(self, poses: np.ndarray) -> bool:
        """Whether bodies at poses (B, 7) may change the answer of the last measurement."""
        if not len(self._gaps):
            return True
        angles = 2.0 * np.arccos(np.minimum(np.abs((poses[:, 3:] * self._poses[:, 3:]).sum(1)), 1.0))
        moved = lengths(poses[:, :3] - self._poses[:, :3]) + self._radii * angles + self._travel
        if self._is_apart:
            return bool(np.any(self._gaps - moved < self._needed + self._ahead()))
        return bool(np.all((moved > self._renewal) & (self._gaps + moved > self._needed + self._renewal)))

    def _measure(self, poses: np.ndarray) -> None:
        """Measure the bodies' clearances at poses (B, 7); park their colliders there where none is in reach."""
        indices = [self._bodies.colliders[name] for name in self._bodies.dynamic]
        self._gaps = np.array([self._solver.clearance(index, mpm.Pose(row[:3], row[3:]))
                               for index, row in zip(indices, poses)])
        self._poses, self._travel = poses, 0.0
        room = 0.0 if self._is_apart else self._renewal
        self._is_apart = bool(np.all(self._gaps > self._needed + self._ahead() + room))
        if self._is_apart:
            self._park()

    def _ahead(self) -> np.ndarray:
        """How far [m] (B,) the bodies may get within a step."""
        twists = self._trial.twists()  # about centres of mass, which the balls hold: no farther than a diameter
        speeds = lengths(twists[:, :3]) + 2.0 * self._radii * lengths(twists[:, 3:])
        return AHEAD * self._trial.model.opt.timestep * speeds
