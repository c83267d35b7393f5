"""The motions that were learnt for sub-tasks, one after the other, as a path that an arm can follow.

Each begins where the one before has ended, turned level and raised or lowered to its own start. Learnt motions jump
from speed to speed every 20 ms; here they are rounded by a moving average, and played slower where the arm needs it.
Learning knew a container that it scooped from and none that it poured into: where the tool comes too close to one, it
is moved away.
"""

from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation, Slerp

from mpm.motion import Pose
from robosim.clearance import RigidParticles
from robosim.config import RehearsalConfig
from robosim.envs.actions import Actions
from robosim.envs.carrier import Carrier
from robosim.envs.task import TaskConfig, load_task
from robosim.errors import ConfigError
from robosim.resources import trained

SAMPLING = 0.002
"""[s] between the samples of a path."""
ROUNDING = 0.08
"""[s] over which a moving average goes, twice."""
JOINING, JOINING_TURN = 0.15, 0.8
"""Speeds [m/s], [rad/s] on the way from the end of a motion to the start of the next."""
REST = 0.5
"""[s] at rest where the load is weighed."""
WIDE = 0.1
"""[s] about a moment that is too fast which are slowed down with it."""
CLEAR = 0.002
"""Least distance [m] of tool and containers: as much as the arm may be off its path there."""
FARTHEST = 0.01
"""[m] by which the tool is moved away from a container; what would need more is played as it was learnt."""
EASED = 0.2
"""[s] over which it is moved away, and back."""
CLEARINGS, LOOK_EVERY, ENOUGH = 8, 10, 1e-4
"""How often a path is moved away from containers at most, samples from one look at them to the next, and what may be
missing [m] in the end."""
NEARBY = 0.5
"""[s] before and after a moment within which the nearest point of a path is looked for."""


class Motion(NamedTuple):
    """Poses of a tool, SAMPLING apart: positions (n, 3) [m], quaternions (n, 4)."""

    places: np.ndarray
    turns: np.ndarray


class Part(NamedTuple):
    """A sub-task's motion and how far [m] (3,) it was carried off from where it was learnt."""

    name: str
    task: TaskConfig
    motion: Motion
    offset: np.ndarray


def shipped(config: RehearsalConfig, name: str) -> Path:
    """File of a sub-task's motion: of the rehearsal's folder of motions, or the one that ships; raises ConfigError
    where there is none."""
    if config.motions is not None:
        path = Path(config.motions) / f"{name}.npz"
        if not path.is_file():
            raise ConfigError(f"motions {config.motions}: holds no {name}.npz; accepted: a folder with a motion of "
                              f"each of {', '.join(config.learned)}")
        return path
    path = trained(name)
    if path is None:
        raise ConfigError(f"no learnt motion ships for {name}; accepted: `robosim train` it, and give a folder with "
                          f"its best.npz as {name}.npz")
    return path


def motion_of(path: Path, name: str, task: TaskConfig) -> Motion:
    """The motion of a file for a sub-task, from its nominal start to where it has done its work; raises ConfigError for
    a file that is none."""
    scale, carrier = Actions(task), Carrier(task)
    poses = [carrier.restart(task.start.pose)]
    try:
        with np.load(path, allow_pickle=False) as stored:
            actions, hold = stored["actions"], int(stored["hold"])
            whole = -(-task.steps // hold)
            decisions = int(stored["needed"]) if "needed" in stored and task.kind == "pour" else whole
        for action in actions[:decisions]:
            poses += [carrier.command(*scale.velocities(action)) for _ in range(hold)]
    except (ValueError, KeyError, EOFError, BadZipFile, ConfigError) as error:
        raise ConfigError(f"{path}: not a motion of {name}: {error}") from error
    given, times = task.step_dt * np.arange(len(poses)), np.arange(0.0, task.step_dt * (len(poses) - 0.5), SAMPLING)
    places = np.array([p.position for p in poses])
    turns = Slerp(given, Rotation.from_quat(np.array([p.quaternion for p in poses]), scalar_first=True))
    return Motion(np.column_stack([np.interp(times, given, column) for column in places.T]),
                  turns(np.minimum(times, given[-1])).as_quat(scalar_first=True))


def chain(config: RehearsalConfig) -> list[Part]:
    """The motions of a rehearsal, the first at the rehearsal's own container, each other where the last has ended."""
    parts: list[Part] = []
    for name in config.learned:
        task = load_task(name)
        if task.tool != config.tool:
            raise ConfigError(f"learned: {name} moves a {task.tool}; the rehearsal's tool is {config.tool}")
        motion = motion_of(shipped(config, name), name, task)
        if parts:
            last = parts[-1]
            offset = (last.motion.places[-1] + last.offset - motion.places[0]) * [1, 1, 0]
        else:
            offset = first_offset(config, name, task)
        parts.append(Part(name, task, motion, offset))
    return parts


def first_offset(config: RehearsalConfig, name: str, task: TaskConfig) -> np.ndarray:
    """From where the first motion was learnt to where the rehearsal's material is; raises ConfigError where that is
    not of the motion's kind."""
    if task.container is not None and task.container_place is not None:
        own = config.containers.get(task.container)
        if own is None or task.container != config.source or own.yaw_deg != task.container_place.yaw_deg:
            raise ConfigError(f"learned: {name} was learnt over a filled container {task.container!r} with yaw_deg "
                              f"{task.container_place.yaw_deg:g}; accepted: one like it in containers")
        return np.array(own.position) - np.array(task.container_place.position)
    if task.start.pile is not None:
        if config.pile is None:
            raise ConfigError(f"learned: {name} was learnt on a pile; accepted: a `pile` on the table")
        return (np.array(config.pile.centre) - np.array(task.start.pile.centre)) * [1, 1, 0]
    if config.tool_fill_height is None:
        raise ConfigError(f"learned: {name} begins with a full {task.tool}; accepted: a tool_fill_height, or a motion "
                          f"that fills it first")
    return np.zeros(3)


def placed(config: RehearsalConfig) -> RehearsalConfig:
    """The rehearsal with its empty container, or its area, where the last learnt motion delivers; a script's stays."""
    if config.trajectory == "script":
        return config
    last = chain(config)[-1]
    x, y, _ = map(float, np.array(last.task.target.centre) + last.offset)
    containers = {name: box.model_copy(update={"position": (x, y, box.position[2])}) if name == config.sink else box
                  for name, box in config.containers.items()}
    area = config.area and config.area.model_copy(update={"centre": (x, y, config.area.centre[2])})
    return config.model_copy(update={"containers": containers, "area": area})


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
            self._keep_clear(RigidParticles(config))
        self._lengths = np.full(count - 1, SAMPLING)
        self._lay()

    def _keep_clear(self, particles: RigidParticles) -> None:
        """Move the tool away from containers, both as learnt and as rounded: played slower it is in between."""
        learnt, turns = self._raw
        places, averaged = learnt, rounded(turns)
        for _ in range(CLEARINGS):
            push, other = pushes(particles, places, turns), pushes(particles, rounded(places), averaged)
            longer = np.linalg.norm(other, axis=1) > np.linalg.norm(push, axis=1)
            push[longer] = other[longer]
            moved = float(np.linalg.norm(places - learnt, axis=1).max())
            if moved > FARTHEST:
                return
            if np.linalg.norm(push, axis=1).max() < ENOUGH:
                self._raw, self.kept_clear_by = (places, turns), moved
                return
            places = places + eased(push)

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


def joined(place: np.ndarray, turn: np.ndarray, to: np.ndarray, to_turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The straight way from a pose to another, at constant speed."""
    ends = Rotation.from_quat(np.stack([turn, to_turn]), scalar_first=True)
    angle = float((ends[0].inv() * ends[1]).magnitude())
    n = max(2, round(max(float(np.linalg.norm(to - place)) / JOINING, angle / JOINING_TURN) / SAMPLING))
    share = np.linspace(0.0, 1.0, n)
    return place + share[:, None] * (to - place), Slerp([0.0, 1.0], ends)(share).as_quat(scalar_first=True)


def pushes(particles: RigidParticles, places: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) [m] of a tool at poses (n, 3), (n, 4) that lead away from the containers."""
    push = np.zeros_like(places)
    for k in range(0, len(places), LOOK_EVERY):
        push[k] = particles.push(Pose(places[k], turns[k] / np.linalg.norm(turns[k])), CLEAR)
    return push


def eased(push: np.ndarray) -> np.ndarray:
    """Displacements (n, 3) that begin and end gently, nowhere smaller than those asked for."""
    size = 2 * round(0.5 * EASED / SAMPLING) + 1
    most = maximum_filter1d(push.clip(min=0.0), size, axis=0) + minimum_filter1d(push.clip(max=0.0), size, axis=0)
    return uniform_filter1d(most, size, axis=0, mode="nearest")


def alike(turns: np.ndarray) -> np.ndarray:
    """The same rotations by quaternions (n, 4) that do not change their sign from one to the next."""
    flips = np.cumprod(np.where(np.sum(turns[1:] * turns[:-1], 1) < 0, -1.0, 1.0))
    return turns * np.concatenate([[1.0], flips])[:, None]


def rounded(values: np.ndarray) -> np.ndarray:
    """A moving average over ROUNDING, twice, of samples (n, k); quaternions are nearly of unit length after it."""
    size = 2 * round(0.5 * ROUNDING / SAMPLING) + 1
    return uniform_filter1d(uniform_filter1d(values, size, axis=0, mode="nearest"), size, axis=0, mode="nearest")
