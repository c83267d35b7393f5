"""One running episode: its reward, its clock, where its tool is, and what a step of it says."""

import math
from typing import Any, Literal, get_args

import mpm
from robosim.errors import ConfigError, UnknownName
from robosim.tasks.counting import TaskCounts
from robosim.tasks.reward import Reward
from robosim.tasks.task import TaskConfig

Horizon = Literal["terminate", "truncate"]


def checked_horizon(horizon: str) -> None:
    """Raise UnknownName for what is none."""
    if horizon not in get_args(Horizon):
        raise UnknownName("horizon", horizon, get_args(Horizon))


class Episode:
    """Takes readings step by step of `step_dt`; knows nothing of what moves the tool."""

    def __init__(self, task: TaskConfig, horizon: Horizon) -> None:
        self.task, self.horizon, self.reward = task, horizon, Reward(task)
        self.running, self.step_count = False, 0
        self.diverged: str | None = None
        self.pose: mpm.Pose = task.start.pose
        """Of the tool; its quaternion follows without a jump of sign."""

    def restart(self, pose: mpm.Pose, now: TaskCounts) -> dict[str, Any]:
        """Begin with the tool at a pose and what is read there; returns the info."""
        self.reward.restart()
        self._start = self.pose = pose
        self.now, self.step_count, self.running, self.diverged = now, 0, True, None
        return self._info({})

    @property
    def progress(self) -> float:
        """Share of the episode that is over."""
        return self.step_count / self.task.steps

    def steps(self, wanted: int) -> int:
        """Steps that an action is held for; begins the sums of its rewards."""
        if not self.running:
            raise ConfigError("step: no episode is running; call reset first")
        self._sums = dict.fromkeys(self.reward.terms, 0.0)
        return min(wanted, self.task.steps - self.step_count)

    def take(self, now: TaskCounts, pose: mpm.Pose) -> None:
        """One step has been taken."""
        sign = -1.0 if self.pose.quaternion @ pose.quaternion < 0 else 1.0
        self.now, self.pose = now, mpm.Pose(pose.position, sign * pose.quaternion)
        self.step_count += 1
        last = self.step_count == self.task.steps
        for name, value in self.reward.step(now, self.turned(), last).items():
            self._sums[name] += value

    def give_up(self, error: Exception) -> None:
        """The episode cannot go on."""
        self.diverged = str(error)
        for name, value in self.reward.give_up(self.task.steps - self.step_count).items():
            self._sums[name] += value

    def outcome(self) -> tuple[float, bool, bool, dict[str, Any]]:
        """Reward of the action, whether the episode has ended or was cut, info."""
        over = self.step_count == self.task.steps
        self.running = not over and self.diverged is None
        info = self._info(self._sums)
        if self.diverged is not None:
            info |= {"diverged": self.diverged, "is_success": False}
        ended = (over and self.horizon == "terminate") or self.diverged is not None
        return float(sum(self._sums.values())), ended, over and not ended, info

    def turned(self) -> float:
        """Angle [rad] by which the tool has turned about its lateral axis since the start."""
        R = self._start.matrix.T @ self.pose.matrix
        return math.atan2(R[0, 2], R[0, 0])

    def _info(self, terms: dict[str, float]) -> dict[str, Any]:
        """Terms of this action's reward, score so far, physical readings."""
        return {
            "reward_terms": dict(terms), "tcs": self.reward.tcs, "tcs_terms": dict(self.reward.score),
            "readings": self.reward.readings(self.now), "is_success": self.reward.succeeded(self.now),
            "time": self.step_count * self.task.step_dt,
        }
