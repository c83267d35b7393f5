"""The privileged term of grains that are tracked one by one, in the layouts of the published task."""

from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.senses.term import SenseScene, Sight, Term, box
from robosim.tasks.counting import observed_grains
from robosim.tasks.observation import grain_bounds, moment_bounds, moments

COLUMNS = {"particles": slice(0, 6), "positions": slice(0, 3), "velocities": slice(3, 6)}
"""Layout -> columns of a grain's row of position and velocity."""
LAYOUTS = (*COLUMNS, "moments")


class GrainsTerm(Term):
    """Grains of the field, which no sensor sees.

    layout: "particles" (position and velocity), "positions", "velocities" or "moments" (statistics of all grains).
    every: True for all grains; False for those that the task observes.
    """

    name, unit = "grains", "m, m/s"
    privileged = all_grains = True

    def __init__(self, scene: SenseScene, layout: str = "particles", every: bool = False) -> None:
        if layout not in LAYOUTS:
            raise ConfigError(f"obs: grains: layout = {layout!r}; accepted: {', '.join(LAYOUTS)}")
        self._task, self._layout = scene.task, layout
        row = grain_bounds(scene.solver.grid, scene.solver.dt)
        if layout == "moments":
            bounds = moment_bounds(scene.task, row).values()
            self.space = box(*(np.concatenate(side) for side in zip(*bounds)))
            return
        self._chosen = np.arange(scene.task.grains.count) if every else observed_grains(scene.task)
        low, high = (np.tile(side[COLUMNS[layout]], (len(self._chosen), 1)) for side in row)
        self.space = box(low, high)

    def measure(self, sight: Sight, memory: Any, rng: np.random.Generator) -> np.ndarray:
        """Return rows of grains (n, 6) or (n, 3), or the moments (m,)."""
        if self._layout == "moments":
            return moments(self._task, sight.grains, sight.pose, sight.counts, sight.setting.place)
        return sight.grains[self._chosen, COLUMNS[self._layout]]
