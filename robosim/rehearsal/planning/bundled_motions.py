"""Learned motions of sub-tasks, from their files: bundled with the package, or from the user's folder."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from mpm.array_files import read_arrays
from robosim.base.errors import ConfigError
from robosim.base.resources import trained
from robosim.config.rehearsal import RehearsalConfig
from robosim.rehearsal.planning.pose_sequences import SAMPLING, PoseSequence
from robosim.tasks.actions import ActionScaling
from robosim.tasks.commanded_pose import move_pose
from robosim.tasks.task import TaskConfig


def find_motion(config: RehearsalConfig, name: str) -> Path:
    """Find the file of a sub-task's motion.

    In the rehearsal's folder `motions` if it has one, else the bundled file. Raises ConfigError where there is none.
    """
    if config.motions is not None:
        path = Path(config.motions) / f"{name}.npz"
        if not path.is_file():
            raise ConfigError(f"motions {config.motions}: holds no {name}.npz; accepted: a folder with a motion of "
                              f"each of {', '.join(config.learned)}")
        return path
    path = trained(name)
    if path is None:
        raise ConfigError(f"no bundled motion for {name}; accepted: `robosim train` it, and give a folder with its "
                          f"best.npz as {name}.npz")
    return path


def load_motion(path: Path, name: str, task: TaskConfig) -> PoseSequence:
    """Load a sub-task's motion, from its nominal start to the end of its work.

    Raises ConfigError where the file holds no motion of the task.
    """
    poses = _replay_actions(path, name, task)
    replayed = task.step_dt * np.arange(len(poses))
    times = np.arange(0.0, task.step_dt * (len(poses) - 0.5), SAMPLING)
    positions = np.array([p.position for p in poses])
    quaternions = np.array([p.quaternion for p in poses])
    rotations = Slerp(replayed, Rotation.from_quat(quaternions, scalar_first=True))
    return PoseSequence(np.column_stack([np.interp(times, replayed, column) for column in positions.T]),
                        rotations(np.minimum(times, replayed[-1])).as_quat(scalar_first=True))


def _replay_actions(path: Path, name: str, task: TaskConfig) -> list:
    """Tool poses, task.step_dt apart, under a file's actions.

    A pour ends after the actions that it needed; other motions are complete, so that the tool is level at the end.
    """
    scaling, poses = ActionScaling(task), [task.start.pose]
    try:
        stored = read_arrays(path)
        actions = np.atleast_1d(stored.numbers("actions"))
        # until release 0.1 action_repeat was called hold
        repeat = stored.integer("action_repeat" if "action_repeat" in stored else "hold", None, 1, task.steps)
        count = -(-task.steps // repeat)
        if task.reward.pours:
            count = stored.integer("needed", count, 1, count)
        for action in actions[:count]:
            for _ in range(repeat):
                poses.append(move_pose(poses[-1], task, *scaling.velocities(action)))
        if len(poses) < 2:
            raise ConfigError("holds no action; accepted: one or more")
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(f"{path}: not a motion of {name}: {str(error).removeprefix(f'{path}: ')}") from None
    return poses
