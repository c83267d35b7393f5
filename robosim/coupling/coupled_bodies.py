"""The bodies that a plugin couples, and the colliders of the solver that represent them."""

from dataclasses import replace
from itertools import zip_longest

import mujoco
import numpy as np

import mpm
from robosim.base.errors import ConfigError, UnknownName
from robosim.coupling.geom_colliders import make_collider
from robosim.robot.mjspec import body_pose


class CoupledBodies:
    """Bodies of a MuJoCo scene with their colliders in a solver.
    bodies: body name -> index of its collider, or None for a new collider made of the body's geoms. is_mobile: whether
    contact moves the bodies within a substep ("mobility"). New and changed colliders are handed to the solver. Raises
    ConfigError for bodies that lie outside the grid, or whose geoms make no collider."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, solver: mpm.Solver, bodies: dict[str, int | None],
                 is_mobile: bool) -> None:
        self._model, self._data, self._solver = model, data, solver
        self.ids = {name: model.body(name).id for name in bodies}
        """Name -> index of the body in MuJoCo."""
        self.driven = [name for name, body in self.ids.items() if model.body_mocapid[model.body_weldid[body]] >= 0]
        """Mocap bodies and bodies fixed to them: the user moves them from step to step, no force does."""
        self.colliders, colliders = self._make_colliders(bodies, is_mobile)
        """Name -> index of the body's collider in the solver."""
        self.moving = [name for name, c in self.colliders.items() if not colliders[c].static]
        """Bodies whose colliders move."""
        self.dynamic = [name for name in self.moving if name not in self.driven]
        """Bodies that MuJoCo moves, and that the grains push."""
        # views: to access an array of data takes as long as to read from it
        self._positions, self._quaternions, self._rows = data.xpos, data.xquat, list(self.ids.values())
        self._dynamic_rows = [self.ids[name] for name in self.dynamic]
        radii = np.array([[colliders[c].sdf.radius] for c in self.colliders.values()]).reshape(-1, 1)
        lower = np.asarray(solver.grid.lower)
        self._least, self._most = lower - radii, lower + solver.grid.cells * solver.grid.cell + radii
        for name in self.find_outside_grid():
            raise ConfigError(f"body {name!r} is at {data.xpos[self.ids[name]].round(4).tolist()} m, outside the "
                              f"solver's grid {solver.grid.lower} .. {solver.grid.upper} m; enlarge the grid, or "
                              f"place the body in it")
        if any(c is not old for c, old in zip_longest(colliders, solver.colliders)):
            solver.set_colliders(colliders)

    def pose(self, name: str) -> mpm.Pose:
        """Return the world pose of a body's frame."""
        return body_pose(self._data, self.ids[name])

    def dynamic_poses(self) -> np.ndarray:
        """Return the world poses (B, 7) of the bodies that MuJoCo moves: position [m], quaternion."""
        rows = self._dynamic_rows
        return np.concatenate([self._positions[rows], self._quaternions[rows]], axis=1)

    def find_outside_grid(self) -> set[str]:
        """Find the bodies whose bounding balls lie outside the solver's grid."""
        places = self._positions[self._rows]
        is_outside = (places < self._least) | (places > self._most)
        return {name for name, row in zip(self.ids, is_outside) if row.any()} if is_outside.any() else set()

    def _make_colliders(self, bodies: dict[str, int | None],
                        is_mobile: bool) -> tuple[dict[str, int], list[mpm.Collider]]:
        indices, colliders = {}, list(self._solver.colliders)
        for name, collider in bodies.items():
            if collider is None:
                collider = len(colliders)
                colliders.append(make_collider(self._model, self._data, self.ids[name], self._solver.grid.cell,
                                               excluded=frozenset(self.ids.values())))
            mobile = is_mobile and not colliders[collider].static and name not in self.driven
            if colliders[collider].mobile != mobile:
                colliders[collider] = replace(colliders[collider], mobile=mobile)
            indices[name] = collider
        return indices, colliders


def check_bodies(model: mujoco.MjModel, solver: mpm.Solver, bodies: dict[str, int | None]) -> None:
    """Raise UnknownName or ConfigError for bodies that cannot be coupled."""
    if not isinstance(bodies, dict):
        raise ConfigError(f"bodies = {bodies!r}; accepted: a dictionary, name of a body -> index of its collider in "
                          f"the solver, or None for a collider made of its geoms, such as {{'spoon': 0, 'box': None}}")
    names = [model.body(i).name for i in range(model.nbody)]
    for name in bodies:
        if name not in names:
            raise UnknownName("body of the MuJoCo model", name, names)
    indices = [c for c in bodies.values() if c is not None]
    if len(set(indices)) != len(indices):
        raise ConfigError(f"bodies = {bodies}: two bodies share a collider; accepted: one collider for each body")
    movable = solver.features.moving_colliders
    for name, collider in bodies.items():
        if collider is not None and collider not in movable:
            raise ConfigError(f"body {name!r}: collider {collider} of the solver cannot move; movable: {movable}")
