"""`robosim export`: demonstrations as transitions in a Minari dataset, or in its HDF5 file alone."""

import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

import mpm
from mpm.files import write
from policies.demonstrations.reading import PlayedDemonstration, read_demonstrations
from policies.learning.environments import environment_id, make_environment
from robosim.base.files import write_json
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.episode.play import run_episode


def export(task: str, demos: Path, out: Path, *, obs: str = "flat", action_repeat: int = 10) -> int:
    """Play every demonstration among grains, from its own start, and write its transitions; return 0.

    out: the folder of a Minari dataset (https://minari.farama.org/content/dataset_standards), whose name is the
    dataset's: data/main_data.hdf5 has the transitions, data/metadata.json the spaces. A name ending in .hdf5 or .h5:
    the file of the transitions alone. Its layout: a group `episode_k` for each, with observations (T + 1, ...), actions
    (T, n), rewards, terminations and truncations (T,), and attributes id, seed, total_steps, demonstration and score;
    on top the attributes total_episodes, total_steps and env_spec.
    Raises mpm.InvalidValue where h5py is not installed, or a path or demonstration is wrong."""
    if find_spec("h5py") is None:
        raise mpm.InvalidValue('robosim export needs h5py: pip install ".[learn]"')
    env = make_environment(task, obs=obs, action_repeat=action_repeat)
    files = dataset_files(out)  # before any work
    episodes = play_demonstrations(env, demos, action_repeat)
    spec = env_spec(env.unwrapped, {"obs": obs, "action_repeat": action_repeat})
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space}
    write_dataset(*files, episodes, {"dataset_id": out.name, "env_spec": spec.to_json(), **{
        key: json.dumps(describe_space(space)) for key, space in spaces.items()}})
    return finish(env, out, episodes)


def finish(env: gymnasium.Env, out: Path, episodes: list[PlayedDemonstration]) -> int:
    """Close the environment and print what was written; return 0."""
    env.close()
    scores = [episode.transitions[-1].info["tcs"] for episode in episodes]
    print(f"{out}: {len(episodes)} episodes, scores {min(scores):.2f} to {max(scores):.2f}")
    return 0


def export_lerobot(task: str, demos: Path, out: Path, *, obs: str = "flat", action_repeat: int = 10,
                   with_pictures: bool = True) -> int:
    """Play every demonstration, from its own start, and write a LeRobot dataset of version 3; return 0.
    One frame a decision: observation.state, action, next.reward, next.done, and a picture of the task's camera. Raises
    mpm.InvalidValue where pyarrow is not installed, or a path, demonstration or observation is wrong."""
    if find_spec("pyarrow") is None:
        raise mpm.InvalidValue('--format lerobot needs pyarrow: pip install ".[lerobot]"')
    from policies.demonstrations.lerobot_dataset import write_lerobot_dataset

    env = make_environment(task, obs=obs, action_repeat=action_repeat,
                           render_mode="rgb_array" if with_pictures else None)
    inner: Any = env.unwrapped
    if not isinstance(env.observation_space, gymnasium.spaces.Box):
        raise mpm.InvalidValue(f"--obs {obs} with --format lerobot; accepted: a layout that is one array")
    episodes = play_demonstrations(env, demos, action_repeat, with_pictures)
    write_lerobot_dataset(out, episodes, fps=1.0 / (action_repeat * inner.task.step_dt), task=inner.task.description,
                          robot=f"{inner.task.tool_name}, moved alone", state=obs)
    return finish(env, out, episodes)


def dataset_files(out: Path) -> tuple[Path, Path | None]:
    """Return the files of transitions and of metadata that `out` stands for, in a folder that exists.
    Raises mpm.InvalidValue, ConfigError for an `out` that cannot be used."""
    is_file = out.suffix in (".hdf5", ".h5")
    if not is_file and not re.fullmatch(r"[-\w]+", out.name):
        raise mpm.InvalidValue(f"--out {out}: a dataset cannot be called {out.name!r}; accepted: letters, digits, - "
                               f"and _, or the name of a file that ends in .hdf5")
    if is_file and out.is_dir():
        raise mpm.InvalidValue(f"--out {out}: a folder; accepted: a name without .hdf5, or a new file")
    OutputFolder(out.parent if is_file else out, is_shared=is_file).release()
    if is_file:
        return out, None
    folder = out / "data"
    folder.mkdir(exist_ok=True)
    return folder / "main_data.hdf5", folder / "metadata.json"


def play_demonstrations(env: gymnasium.Env, demos: Path, action_repeat: int,
                        with_pictures: bool = False) -> list[PlayedDemonstration]:
    """Play the demonstrations of a folder, or of one file, in an environment."""
    inner: Any = env.unwrapped
    decisions, dimensions = -(-inner.task.steps // action_repeat), inner.task.action.dimensions
    episodes = []
    read = read_demonstrations(demos, decisions, action_repeat, dimensions, inner.TASK)
    for name, actions, seed, options in Progress(read, desc="playing", unit="demonstrations"):
        transitions, pictures = [], []
        for transition in run_episode(env, actions, seed=seed, options=options):
            transitions.append(transition)
            if with_pictures:
                pictures.append(env.render())
        if with_pictures:  # the picture before an action is the one after the action before, or of the start
            env.reset(seed=seed, options=options)
            pictures = [env.render(), *pictures[:-1]]
        episodes.append(PlayedDemonstration(name, seed, transitions, np.stack(pictures) if pictures else None))
    return episodes


def env_spec(env: Any, options: dict[str, Any]) -> EnvSpec:
    """Return the specification with which `gymnasium.make` makes a sub-task's environment."""
    name, own = environment_id(env.source)
    registered = gymnasium.spec(name)
    return EnvSpec(id=registered.id, entry_point=registered.entry_point, kwargs={**own, **options})


def describe_space(space: gymnasium.Space) -> dict[str, Any]:
    """Return a space as Minari's metadata have it: a Box, or a Dict of them."""
    if isinstance(space, gymnasium.spaces.Dict):
        return {"type": "Dict", "subspaces": {key: describe_space(part) for key, part in space.items()}}
    assert isinstance(space, gymnasium.spaces.Box), space
    return {"type": "Box", "dtype": str(space.dtype), "shape": list(space.shape), "low": space.low.tolist(),
            "high": space.high.tolist()}


def write_dataset(file: Path, metadata: Path | None, episodes: list[PlayedDemonstration], more: dict[str, str]) -> None:
    """Write the transitions, then the metadata if there are any: Minari takes a folder for a dataset only with them.
    more: entries of the metadata besides totals and format; "env_spec" is in the file of transitions, too."""
    import h5py

    totals = {"total_episodes": len(episodes), "total_steps": sum(len(episode.transitions) for episode in episodes)}

    def write_episodes(path: Path) -> None:
        with h5py.File(path, "w") as opened:
            opened.attrs.update(totals | {"env_spec": more["env_spec"]})
            for k, episode in enumerate(episodes):
                write_episode(opened.create_group(f"episode_{k}"), k, episode)

    if metadata is not None:
        metadata.unlink(missing_ok=True)  # those of an earlier dataset, which has other transitions
    write(file, write_episodes)
    if metadata is not None:
        write_json(metadata, {**more, **totals, "data_format": "hdf5", "dataset_size": file.stat().st_size / 1e6,
                              "minari_version": "0.5.3"})  # of the format; Minari opens those that it knows


def write_episode(group: Any, k: int, episode: PlayedDemonstration) -> None:
    """Write one episode into its group of an HDF5 file."""
    steps = episode.transitions
    group.attrs.update({"id": k, "seed": episode.seed, "total_steps": len(steps), "demonstration": episode.name,
                        "tcs": steps[-1].info["tcs"], "is_success": bool(steps[-1].info["is_success"])})
    observations = [steps[0].observation, *(step.next_observation for step in steps)]
    seen = {f"observations/{key}": [one[key] for one in observations] for key in observations[0]} \
        if isinstance(observations[0], dict) else {"observations": observations}
    for name, values in seen.items():
        group.create_dataset(name, data=np.stack(values), compression="gzip")
    truncated = np.array([step.info["TimeLimit.truncated"] for step in steps])
    for name, values in {"actions": [step.action for step in steps], "rewards": [step.reward for step in steps],
                         "terminations": np.array([step.done for step in steps]) & ~truncated,
                         "truncations": truncated}.items():
        group.create_dataset(name, data=np.array(values))
