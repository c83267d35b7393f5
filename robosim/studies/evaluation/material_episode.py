"""One episode of a policy in one material, a job of a study."""

from typing import Any

from robosim.envs import make
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import Transition, play
from robosim.randomization.materials import MATERIALS
from robosim.studies.evaluation.policies import make_policy, training_options
from robosim.tasks.task import load_task

READINGS = ("delivered", "spilled", "collisions")
OWN = "the task's own"
"""Label of the task's own material, from which the trajectory's deviation is measured."""


def play_in_material(task: str, name: str, label: str) -> dict[str, Any]:
    """Run an episode from the task's own start; return its score, readings and trajectory.
    The trajectory is the centre [m] (3,) of the observed grains after each action, as long as the simulation does not
    diverge."""
    base, numbers = MATERIALS[label] if label != OWN else (load_task(task).material, {})
    options: dict[str, Any] = {"material": base, **numbers, **training_options(name)}
    made = make(task, **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    observation, _ = env.reset(seed=0, options={"nominal": True})
    trajectory: list[list[float]] = []

    def follow(step: Transition) -> None:
        if not step.info.get("diverged"):
            trajectory.append(env.world.grains()[:, :3].mean(0).astype(float).tolist())

    _, info = play(env, make_policy(name, env, 0), observation=observation, hooks=[follow])
    made.close()
    diverged = str(info["diverged"]) if info.get("diverged") else None
    return {"score": info["tcs"], "trajectory": trajectory, "diverged": diverged,
            **{key: info["readings"].get(key) for key in READINGS}}
