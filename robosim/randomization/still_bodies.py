"""Bodies that stand in the world and are put to other places between episodes."""

import mujoco
import numpy as np

import mpm
from robosim.randomization.draw import HOME


class StillBodies:
    """Bodies of a compiled model without joints, by their names; what is drawn or computed next has them there."""

    def __init__(self, model: mujoco.MjModel, names: list[str]) -> None:
        self._model = model
        self._home = {body: mpm.Pose(model.body_pos[body].copy(), model.body_quat[body].copy())
                      for body in (model.body(name).id for name in names)}
        self._place = HOME

    def place(self, place: mpm.Pose) -> bool:
        """Put the bodies where a displacement has them; return whether they were elsewhere."""
        if place is self._place or all(np.array_equal(one, other) for one, other in zip(place, self._place)):
            return False
        self._place = place
        for body, home in self._home.items():
            pose = home if place is HOME else place @ home
            self._model.body_pos[body], self._model.body_quat[body] = pose
        return True
