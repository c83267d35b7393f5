"""A task's script as a policy."""

from typing import Any

import numpy as np

from robosim.envs.grain_env import GrainEnv
from robosim.tasks.actions import follow, move_pose


class ScriptedPolicy:
    """Follows the waypoints of the task's script from where the tool is; what is commanded and not yet done counts.
    knows: whether they are displaced with the target, which no sensor has to find: a reference, and an expert. closing:
    as of `robosim.tasks.actions.follow`; with one the path begins at the task's own start, which the tool approaches,
    where the script alone is at its first waypoint in time, however fast."""

    def __init__(self, env: GrainEnv, knows: bool = False, closing: float = 0.0) -> None:
        place = env.carrier.setting.place if knows else None
        start = None if closing else env.carrier.commanded.position
        self._env, self._path, self._closing = env, env.task.scripted_path(start, place), closing

    def __call__(self, observation: Any) -> np.ndarray:
        """Return the next action; the observation is not needed."""
        env, task = self._env, self._env.task
        now, begin = env.carrier.commanded, env.step_count
        for linear, angular, *_, steps in env.member.delay.waiting:
            begin += steps
            for _ in range(steps):
                now = move_pose(now, task, linear, angular)
        duration = max(min(env.action_repeat, task.steps - begin), 1) * task.step_dt
        return follow(task, self._path, now, begin * task.step_dt, duration, self._closing).astype(np.float32)
