"""Learnt motions one after the other as a path that an arm can follow.

Each begins where the one before has ended, turned level and raised or lowered to its own start. Learnt motions jump
from speed to speed every 20 ms; here they are rounded by a moving average, kept clear of containers, and played slower
where the arm needs it.
"""

import numpy as np
from scipy.ndimage import maximum_filter1d
from scipy.spatial.transform import Rotation, Slerp

from mpm.geometry.rigid_motion import Pose
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.keep_clear import kept_clear
from robosim.rehearsal.learned import chain
from robosim.rehearsal.pose_sequences import ROUNDING, SAMPLING, alike, joined, rounded
from robosim.scene.container_clearance import ContainerSurface

REST = 0.5
"""[s] at rest where the load is weighed."""
WIDE = 0.1
"""[s] about a moment that is too fast which are slowed down with it."""
NEARBY = 0.5
"""[s] before and after a moment within which the nearest point of a path is looked for."""


class LearnedPath:
    """Poses over time along a chain of learnt motions; `slow_down` gives the arm the time that it needs."""

    def __init__(self, config: RehearsalConfig) -> None:
        places, turns, count = [], [], 0
        self._marks: dict[str, int] = {}
        self._rests: dict[str, tuple[int, int]] = {}

        def add(more_places: np.ndarray, more_turns: np.ndarray) -> None:
            nonlocal count
            places.append(more_places)
            turns.append(more_turns)
            count += len(more_places)

        def rest(duration: float) -> None:
            n = round(duration / SAMPLING)
            add(np.repeat(places[-1][-1:], n, 0), np.repeat(turns[-1][-1:], n, 0))

        def weigh(now: bool) -> None:
            if now and config.weigh_at is not None and not self._rests:
                self._rests[config.weigh_at] = (count, count + round(REST / SAMPLING))
                rest(REST + 2 * ROUNDING)

        for k, part in enumerate(chain(config)):
            own = part.motion.places + part.offset
            if k == 0:
                add(own[:1], part.motion.turns[:1])
            else:
                add(*joined(places[-1][-1], turns[-1][-1], own[0], part.motion.turns[0]))
            rest(2 * ROUNDING)
            weigh(k > 0 or config.tool_fill_height is not None)
            self._marks[part.name] = count
            add(own, part.motion.turns)
            rest(2 * ROUNDING)
        weigh(True)
        self._marks["end"] = count - 1
        self._raw = np.concatenate(places), alike(np.concatenate(turns))
        self.kept_clear_by = 0.0
        """Largest distance [m] by which the tool was moved away from a container."""
        if config.containers:
            learnt, quaternions = self._raw
            self._raw = kept_clear(ContainerSurface(config), learnt, quaternions), quaternions
            self.kept_clear_by = float(np.linalg.norm(self._raw[0] - learnt, axis=1).max())
        self._lengths = np.full(count - 1, SAMPLING)
        self._lay()

    def _lay(self) -> None:
        """Sample the motion anew, its steps as long as they are now, and round it."""
        old = np.concatenate([[0.0], np.cumsum(self._lengths)])
        times = np.linspace(0.0, old[-1], round(old[-1] / SAMPLING) + 1)
        asked, turns = [np.column_stack([np.interp(times, old, column) for column in values.T]) for values in self._raw]
        self._places, self._step, self.duration = rounded(asked), times[1], float(times[-1])
        self._turns = Slerp(times, Rotation.from_quat(rounded(turns), scalar_first=True))
        self._old, self._grid = old, times
        self.times = {name: float(old[k]) for name, k in self._marks.items()}
        """When each motion begins, and when the last one ends [s]."""
        self.rests = {name: (float(old[a]), float(old[b])) for name, (a, b) in self._rests.items()}
        self.rounded_by = float(np.linalg.norm(self._places - asked, axis=1).max())
        """Largest distance [m] between the learnt motion and this path."""
        self.slower_by = float(self.duration / (SAMPLING * len(self._lengths)))
        """Its duration over the learnt one's, rests included."""

    def slow_down(self, times: np.ndarray, factors: np.ndarray) -> None:
        """Take so many times longer about times [s] (n,) of the present path."""
        wide = maximum_filter1d(np.maximum(factors, 1.0), max(1, round(WIDE / (times[1] - times[0]))))
        middles = 0.5 * (self._old[1:] + self._old[:-1])
        self._lengths = self._lengths * np.interp(middles, times, wide)
        self._lay()

    def pose(self, time: float) -> Pose:
        """Tool pose at a time [s]."""
        time = min(max(time, 0.0), self.duration)
        place = np.array([np.interp(time, self._grid, column) for column in self._places.T])
        return Pose(place, self._turns(time).as_quat(scalar_first=True))

    def near(self, time: float, tip: np.ndarray) -> np.ndarray:
        """Places of the tool's origin and of a point of its frame (n, 6) [m] about a time [s]."""
        moments = np.arange(time - NEARBY, time + NEARBY, 2 * self._step)
        index = np.clip(np.rint(moments / self._step).astype(int), 0, len(self._grid) - 1)
        return np.hstack([self._places[index], self._places[index] + self._turns(self._grid[index]).apply(tip)])
