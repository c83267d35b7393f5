"""`robosim frames`: roll-outs of the simulator with starts and motions of many kinds, for a network to learn from."""

import json
import sys
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from tqdm import tqdm

import mpm
from policies.demonstrations.action_repeat import Hold
from policies.demonstrations.generator import fingerprint
from policies.demonstrations.spline_search import motion
from policies.demonstrations.workers import pool
from policies.learning.environments import made
from policies.learning.files import claim, write, write_json

KNOTS, SPREAD = 8, 0.4
"""Of the smooth motion that is added to a part of the script: knots, and standard deviation of its actions."""
SOLIDS = 150
"""Points that stand for the surface of a tool or a container."""


class Solid(NamedTuple):
    """What a network sees of something rigid."""

    points: np.ndarray
    """(n, 3), SOLIDS at most, near its surface [m]: in its own frame if it moves, in world axes if it stands."""
    moves: bool


def frames(task: str, out: Path, *, episodes: int = 200, material: str | None = None, hold: int = 10, seed: int = 0,
           jobs: int = 1) -> int:
    """Make roll-outs 0 .. episodes - 1 into a folder; returns 0. Raises InvalidValue for what cannot be made, and for a
    folder of others."""
    if min(episodes, hold, jobs) < 1 or seed < 0:
        raise mpm.InvalidValue(f"--episodes {episodes}, --action-repeat {hold}, --jobs {jobs}, --seed {seed}; "
                               f"accepted: 1 or more, the seed 0 or more")
    env: Any = made(task, material=material, action_repeat=hold).unwrapped
    lock = claim(out)
    try:
        _fill(out, env, material, episodes=episodes, seed=seed, jobs=jobs)
    finally:
        lock.release()
    print(f"{out}: {episodes} roll-outs of up to {-(-env.task.steps // hold) + 1} frames")
    return 0


def _fill(out: Path, env: Any, material: str | None, *, episodes: int, seed: int, jobs: int) -> None:
    """Make what a folder lacks; see `frames`."""
    told, about = {**of(env), "seed": seed}, out / "frames.json"
    if about.is_file() and about.read_text() != json.dumps(told, indent=2) + "\n":
        raise mpm.InvalidValue(f"--out {out}: holds roll-outs of {' '.join(about.read_text().split())}; give another "
                               f"folder")
    write_json(about, told)
    waiting = [k for k in range(episodes) if not path_of(out, k).is_file()]
    progress = tqdm(initial=episodes - len(waiting), total=episodes, unit="roll-out", file=sys.stderr)
    if jobs == 1:
        for k in waiting:
            make(env, out, seed, k)
            progress.update()
    else:
        with pool(jobs) as workers:
            for _ in workers.map(partial(made_apart, env.source, material, env.action_repeat, out, seed), waiting):
                progress.update()
    progress.close()


def of(env: Any) -> dict[str, Any]:
    """What roll-outs of an environment are of."""
    return {"task": env.TASK, "hold": env.action_repeat, "grains": len(seen(env)), "scene": fingerprint(env)}


def path_of(out: Path, k: int) -> Path:
    """File of a roll-out."""
    return out / f"rollout_{k:05d}.npz"


@cache
def environment(task: str, material: str | None, hold: int) -> Any:
    """The sub-task, made once in a process."""
    return made(task, material=material, action_repeat=hold).unwrapped


def made_apart(task: str, material: str | None, hold: int, out: Path, seed: int, k: int) -> None:
    """A roll-out in a process of its own."""
    make(environment(task, material, hold), out, seed, k)


def make(env: Any, out: Path, seed: int, k: int) -> None:
    """Roll-out k, kept as grains (frames, n, 3) and tool (frames, 7), in world axes [m]."""
    rng = np.random.default_rng([seed, k])
    env.reset(seed=int(rng.integers(2**31)), options={"nominal": bool(rng.integers(2))})
    hold = Hold(env.task, env.action_repeat)
    hold.begin(env.solver.collider_pose(0).position)
    script = rng.uniform(0.0, 1.2) * hold.follow(env.task, env.task.steps * env.task.step_dt)
    aside = motion(rng.normal(0.0, SPREAD, (KNOTS, hold.dimensions)), hold.n)
    grains, poses = [seen(env)], [pose_of(env)]
    for action in np.clip(script + rng.uniform() * aside, -1.0, 1.0).astype(np.float32):
        _, _, ended, cut, info = env.step(action)
        if info.get("diverged"):
            break
        grains.append(seen(env))
        poses.append(pose_of(env))
        if ended or cut:
            break
    write(path_of(out, k), lambda path: np.savez_compressed(path, grains=np.array(grains, np.float32),
                                                            tool=np.array(poses)))


def seen(env: Any) -> np.ndarray:
    """Places of the observed grains (n, 3); a copy, for the next reading goes to the same memory."""
    return env.world.grains()[:, :3].copy()


def pose_of(env: Any) -> np.ndarray:
    """The tool's pose (7,)."""
    return np.concatenate(env.solver.collider_pose(0))


def solids(env: Any) -> list[Solid]:
    """The scene's tool and, standing where they are, what else is rigid; each as points drawn from its surface."""
    found, rng = [], np.random.default_rng(0)
    for index, collider in enumerate(env.solver.colliders):
        lower, upper = collider.sdf.bounds
        drawn = rng.uniform(lower, upper, (200_000, 3))
        near = np.abs(collider.sdf.distance(drawn)) < 0.02 * np.linalg.norm(upper - lower)
        points = drawn[near][:SOLIDS]
        pose = env.solver.collider_pose(index)
        found.append(Solid(points if index == 0 else pose.apply(points), index == 0))
    return found


class Rollouts(NamedTuple):
    """What `robosim frames` has made of a task."""

    grains: list[np.ndarray]
    """(frames, n, 3) of each roll-out [m]."""
    poses: list[np.ndarray]
    """(frames, 7) of its tool."""


def read(folder: Path, env: Any) -> Rollouts:
    """All roll-outs of a folder of two frames or more; raises InvalidValue where it holds none of an environment."""
    wanted = of(env)
    try:
        told = json.loads((folder / "frames.json").read_text())
        other = [f"{name} {told[name]}, now {value}" for name, value in wanted.items() if told[name] != value]
        if other:
            raise mpm.InvalidValue(f"--frames {folder}: of another environment: {'; '.join(other)}")
        found = []
        for path in sorted(folder.glob("rollout_*.npz")):
            with np.load(path, allow_pickle=False) as stored:
                if len(stored["grains"]) > 1:  # one that diverged at once has nothing to learn from
                    found.append((stored["grains"], stored["tool"]))
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise mpm.InvalidValue(f"--frames {folder}: {error}; `robosim frames {env.source} --out {folder}` makes "
                               f"them") from error
    if len(found) < 2:
        raise mpm.InvalidValue(f"--frames {folder}: {len(found)} roll-outs; accepted: 2 or more, of which some are "
                               f"held back for the test")
    return Rollouts(*map(list, zip(*found)))
