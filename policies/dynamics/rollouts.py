"""`robosim rollouts`: rollouts of the simulator with various starts and motions, for a network to learn from."""

import json
from contextlib import ExitStack
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.array_files import MAX_STATE, read_arrays
from mpm.files import write
from policies.demonstrations.action_repeat import ActionRepeat
from policies.demonstrations.spline_search import sample_spline
from policies.learning.environments import fingerprint, make_environment
from policies.learning.options import check_at_least
from robosim.base.files import write_json
from robosim.base.input_files import read_json, read_text
from robosim.base.jobs import worker_pool
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.episode.play import continue_episode


class Rollouts(NamedTuple):
    """The rollouts of a folder."""

    grains: list[np.ndarray]
    """Positions of each rollout's grains [m], (frames, n, 3)."""
    poses: list[np.ndarray]
    """Poses of each rollout's tool (frames, 7)."""


def describe_environment(env: Any) -> dict[str, Any]:
    """Return what rollouts of an environment must have in common."""
    return {"task": env.TASK, "action_repeat": env.action_repeat, "grains": len(grain_positions(env)),
            "scene": fingerprint(env)}


def grain_positions(env: Any) -> np.ndarray:
    """Return the positions of the observed grains [m], (n, 3); a copy, because the environment reuses its array."""
    return env.world.grains()[:, :3].copy()


def rollout_path(folder: Path, k: int) -> Path:
    """Return the file of rollout k."""
    return folder / f"rollout_{k:05d}.npz"


def read_rollouts(folder: Path, env: Any) -> Rollouts:
    """Return all rollouts of a folder with two frames or more.
    Raises mpm.InvalidValue where the folder holds fewer than two, or they are of another environment."""
    now = describe_environment(env)
    try:
        stored = read_json(folder / "rollouts.json")
        differences = [f"{name} {stored[name]}, now {value}" for name, value in now.items() if stored[name] != value]
        if differences:
            raise mpm.InvalidValue(f"--rollouts {folder}: of another environment: {'; '.join(differences)}")
        pairs, size = [], 0
        for path in sorted(folder.glob("rollout_*.npz")):
            arrays = read_arrays(path, MAX_STATE)
            grains, tool = arrays.numbers("grains"), arrays.numbers("tool")
            frames = len(np.atleast_1d(grains))
            if grains.shape[1:] != (now["grains"], 3) or tool.shape != (frames, 7):
                raise mpm.InvalidValue(f"{path.name}: grains have shape {grains.shape}, tool has {tool.shape}; "
                                       f"accepted: (n, {now['grains']}, 3) and (n, 7)")
            size += grains.nbytes + tool.nbytes
            if size > MAX_STATE:
                raise mpm.InvalidValue(f"{path.name}: with those before it {size} bytes; accepted: up to {MAX_STATE} "
                                       f"in all rollouts together")
            if frames > 1:  # one that diverged in its first step has a single frame
                pairs.append((grains, tool))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise mpm.InvalidValue(f"--rollouts {folder}: {error}; `robosim rollouts {env.source} --out {folder}` makes "
                               f"them") from error
    if len(pairs) < 2:
        raise mpm.InvalidValue(f"--rollouts {folder}: {len(pairs)} rollouts; accepted: 2 or more, some of which are "
                               f"the test set")
    return Rollouts(*map(list, zip(*pairs)))


KNOTS, SPREAD = 8, 0.4
"""Of the random smooth motion that is added to the script: knots, and standard deviation of its actions."""


def make_rollouts(task: str, out: Path, *, episodes: int = 200, material: str | None = None, action_repeat: int = 10,
                  seed: int = 0, jobs: int = 1) -> int:
    """Make rollouts 0 to episodes - 1 in a folder, where they are missing; return 0.
    Raises mpm.InvalidValue for an argument outside its range, or a folder with other rollouts."""
    check_at_least(1, {"--episodes": episodes, "--action-repeat": action_repeat, "--jobs": jobs})
    check_at_least(0, {"--seed": seed})
    made_with = task, material, action_repeat
    env = cached_environment(*made_with)
    with OutputFolder(out), ExitStack() as stack:
        path, description = out / "rollouts.json", {**describe_environment(env), "seed": seed}
        stored = read_text(path) if path.is_file() else None
        if stored is not None and stored != json.dumps(description, indent=2) + "\n":
            raise mpm.InvalidValue(f"--out {out}: holds rollouts of {' '.join(stored.split())[:2000]}; give another "
                                   f"folder")
        write_json(path, description)
        missing = [k for k in range(episodes) if not rollout_path(out, k).is_file()]
        work = partial(make_rollout, made_with, out, seed)
        made = (map if jobs == 1 else stack.enter_context(worker_pool(jobs)).map)(work, missing)
        for _ in Progress(made, initial=episodes - len(missing), total=episodes, desc="rollouts", unit="episodes"):
            pass
    print(f"{out}: {episodes} rollouts of up to {-(-env.task.steps // action_repeat) + 1} frames")
    return 0


@cache
def cached_environment(task: str, material: str | None, action_repeat: int) -> Any:
    """Return the sub-task's environment, made once in a process."""
    return make_environment(task, material=material, action_repeat=action_repeat).unwrapped


def make_rollout(made_with: tuple[str, str | None, int], out: Path, seed: int, k: int) -> None:
    """Make rollout k: grains (frames, n, 3) [m] and tool poses (frames, 7), in world axes.
    made_with: arguments of `cached_environment`."""
    env, rng = cached_environment(*made_with), np.random.default_rng([seed, k])
    observation, _ = env.reset(seed=int(rng.integers(2**31)), options={"nominal": bool(rng.integers(2))})
    grains, poses = [grain_positions(env)], [tool_pose(env)]
    for step in continue_episode(env, random_motion(env, rng), observation):
        if step.info.get("diverged"):
            break
        grains.append(grain_positions(env))
        poses.append(tool_pose(env))
    write(rollout_path(out, k), lambda path: np.savez_compressed(path, grains=np.array(grains, np.float32),
                                                                 tool=np.array(poses)))


def random_motion(env: Any, rng: np.random.Generator) -> np.ndarray:
    """Return actions (decisions, dimensions): a share of the script plus a random smooth motion."""
    motion = ActionRepeat(env.task, env.action_repeat)
    motion.set_start(env.solver.collider_pose(0).position)
    script = rng.uniform(0.0, 1.2) * motion.follow_script(env.task, env.task.steps * env.task.step_dt)
    smooth = sample_spline(rng.normal(0.0, SPREAD, (KNOTS, motion.dimensions)), motion.decisions)
    return np.clip(script + rng.uniform() * smooth, -1.0, 1.0).astype(np.float32)


def tool_pose(env: Any) -> np.ndarray:
    """Return the tool's pose: position [m] and quaternion (w, x, y, z), (7,)."""
    return np.concatenate(env.solver.collider_pose(0))
