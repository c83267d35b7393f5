"""Folders of rollouts: what they belong to, and reading them."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.array_files import MAX_STATE, read_arrays
from policies.learning.environments import fingerprint
from robosim.base.files import write_json
from robosim.base.input_files import read_json, read_text


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


def write_description(folder: Path, env: Any, seed: int) -> None:
    """Write rollouts.json; raises mpm.InvalidValue for a folder of other rollouts."""
    path, description = folder / "rollouts.json", {**describe_environment(env), "seed": seed}
    stored = read_text(path) if path.is_file() else None
    if stored is not None and stored != json.dumps(description, indent=2) + "\n":
        raise mpm.InvalidValue(f"--out {folder}: holds rollouts of {' '.join(stored.split())[:2000]}; give another "
                               f"folder")
    write_json(path, description)


def read_rollouts(folder: Path, env: Any) -> Rollouts:
    """Return all rollouts of a folder with two frames or more.

    Raises mpm.InvalidValue where the folder holds fewer than two, or they are of another environment.
    """
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
