"""Cases of environments: every bundled task with the tool alone and with an arm, senses, random scenes, batches."""

from typing import Any

import gymnasium
import numpy as np
from groups import case_of
from internals import dosing_action, dosing_terms, keep_solver, scripted_action, solver_of, vector_solvers
from keep import Keep

import robosim  # noqa: F401  (registers the environments)

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove", "DoseSpoon", "DoseScoop", "DoseBottle", "DoseShaker", "ScoopTo")
LONG = ("DoseScoop", "DoseBottle")
"""Tasks whose first start takes more than a minute to settle: with --full."""
ALONE = tuple(task for task in TASKS if task not in ("SpoonPour", "SpoonScoop", "DoseSpoon", *LONG))
WITH_ARM = ("SpoonScoop", "SpoonPour", "BottlePickPour", "ShovelMove")
"""Tasks that are usually run with an arm; the others with --full."""
SENSES = ["tool", "wrist", "height_map", "grains", "goal", "time", "scale", {"name": "depth", "noise_model": "stereo"}]
ARM_SENSES = ["joints", "torques", "tool", "wrist", "height_map", {"name": "depth", "camera": "hand_wrist"}]


def keep_step(keep: Keep, observation: Any, info: Any, *rest: Any) -> None:
    """Keep what `reset` or `step` has returned."""
    keep("observation", observation)
    keep("info", info)
    for name, value in zip(("reward", "terminated", "truncated"), rest):
        keep(name, value)


def act(keep: Keep, task: str, steps: int, seed: int = 0, reset: dict[str, Any] | None = None, **options: Any) -> None:
    """Random actions in an environment."""
    env = gymnasium.make(f"robosim/{task}-v0", **options)
    rng = np.random.default_rng(7)
    keep_step(keep, *env.reset(seed=seed, options=reset))
    keep("start", solver_of(env).state())  # a ledger is left from what was before
    for _ in range(steps):
        action = (0.6 * rng.uniform(-1.0, 1.0, env.action_space.shape)).astype(np.float32)
        observation, *rest, info = env.step(action)
        keep_step(keep, observation, info, *rest)
    keep_solver(keep, solver_of(env))
    env.close()


def perform(keep: Keep, task: str, most: int = 10_000, controller: str | None = None, **options: Any) -> None:
    """Run the scripted motion of a task, or a controller of its dose, from the nominal start."""
    obs = {"obs": dosing_terms()} if controller else {}
    env = gymnasium.make(f"robosim/{task}-v0", **obs, **options)
    env.reset(seed=0, options={"nominal": True})
    policy = dosing_action(env, controller) if controller else scripted_action(env)
    for _ in range(most):
        observation, *rest, info = env.step(policy())
        keep_step(keep, observation, info, *rest)
        if rest[1] or rest[2]:
            break
    keep_solver(keep, solver_of(env))
    env.close()


def return_to(keep: Keep, task: str, **options: Any) -> None:
    """Save the state of an environment, go on, load it, and go on again."""
    env = gymnasium.make(f"robosim/{task}-v0", **options)
    env.reset(seed=3)
    action = np.full(env.action_space.shape, 0.3, np.float32)
    env.step(action)
    state = env.unwrapped.state()
    keep("state", state["solver"])
    for _ in range(2):
        for _ in range(2):
            observation, *rest, info = env.step(action)
            keep_step(keep, observation, info, *rest)
        env.unwrapped.load(state)
    env.close()


def together(keep: Keep, task: str, steps: int, num_envs: int = 3, **options: Any) -> None:
    """Random actions in a vector environment."""
    env = gymnasium.make_vec(f"robosim/{task}-v0", num_envs=num_envs, **options)
    rng = np.random.default_rng(7)
    keep_step(keep, *env.reset(seed=5))
    for _ in range(steps):
        actions = (0.6 * rng.uniform(-1.0, 1.0, env.action_space.shape)).astype(np.float32)
        observation, *rest, info = env.step(actions)
        keep_step(keep, observation, info, *rest)
    for solver in vector_solvers(env):
        keep("grains", solver.state())
    env.close()


CASES = [  # those of a task follow each other: an environment takes over the kernels of an equal one that was closed
    *case_of(("f32",), "env/SpoonPour", act, "SpoonPour", 5),
    *case_of(("f32",), "env/state", return_to, "SpoonPour"),
    *case_of(("f32",), "env/senses", act, "SpoonPour", 5, obs=SENSES, latency=0.02, noise=1e-3, dropout=0.1,
             action_delay=0.03, privileged=["grains", "wrist"]),
    *case_of(("f32",), "batch/SpoonPour", together, "SpoonPour", 5, workers=1),
    *case_of(("f32",), "env/SpoonScoop", act, "SpoonScoop", 5),
    *case_of(("f32",), "script/SpoonScoop", perform, "SpoonScoop"),
    *case_of(("f32",), "env/wide", act, "SpoonScoop", 4, randomize="wide"),
    *case_of(("f32",), "env/DoseSpoon", act, "DoseSpoon", 5),
    *case_of(("f32",), "dose/pi", perform, "DoseSpoon", 15, controller="pi"),
    *(case for task in ALONE for case in case_of(("f32",), f"env/{task}", act, task, 5)),
    *(case for task in WITH_ARM for case in case_of(("f32",), f"arm/{task}", act, task, 2, arm=True)),
    *case_of(("f32",), "arm/panda", act, "SpoonPour", 3, arm=True, robot="panda"),
    *case_of(("f32",), "arm/ur5e", act, "ShovelMove", 3, arm=True, robot="ur5e"),
    *case_of(("f32",), "arm/senses", act, "SpoonPour", 3, arm=True, obs=ARM_SENSES),
    *case_of(("f32",), "arm/state", return_to, "SpoonPour", arm=True),
    *case_of(("f64",), "env/SpoonPour", act, "SpoonPour", 5),
]
MORE = [
    *(case for task in LONG for case in case_of(("f32",), f"env/{task}", act, task, 5)),
    *(case for task in TASKS if task not in WITH_ARM for case in
      case_of(("f32",), f"arm/{task}", act, task, 2, arm=True)),
    *case_of(("f32",), "script/ShovelMove", perform, "ShovelMove"),
    *case_of(("f64",), "arm/SpoonPour", act, "SpoonPour", 2, arm=True),
    *case_of(("f32",), "batch/arms", together, "SpoonTranslate", 2, num_envs=2, workers=1, arm=True),
    *case_of(("f32",), "arm/wide", act, "ScoopPour", 3, arm=True, randomize="wide"),
    *(case for task in TASKS if task != "SpoonPour" for case in case_of(("f64",), f"env/{task}", act, task, 5)),
    *(case for task in TASKS if task != "SpoonPour" for case in case_of(("f64",), f"arm/{task}", act, task, 2,
                                                                        arm=True)),
    *(case for task in ("ScoopScoop", "SpoonPour", "BottlePickPour") for case in
      case_of(("f32",), f"script/{task}", perform, task)),
    *case_of(("f32",), "arm/script", perform, "SpoonScoop", arm=True),
    *case_of(("f32",), "arm/xarm7", act, "ScoopPour", 3, arm=True, robot="xarm7"),
    *case_of(("f32",), "arm/friction grasp", act, "ScoopTranslate", 3, arm=True, grasp="friction"),
    *case_of(("f32",), "env/flour", act, "SpoonPour", 3, material="flour"),
    *case_of(("f32",), "env/all grains", act, "SpoonPour", 3, obs="all", action_delay=0.01, horizon="truncate"),
    *case_of(("f32",), "env/moments", act, "SpoonPour", 3, obs="moments", action_repeat=25),
    *case_of(("f64",), "env/wide", act, "SpoonScoop", 4, randomize="wide"),
    *case_of(("f64",), "env/senses", act, "SpoonPour", 5, obs=SENSES, latency=0.02, noise=1e-3),
    *case_of(("f32",), "env/point cloud", act, "ScoopScoop", 3, obs=["goal", "point_cloud", "tool"], flatten=True),
    *case_of(("f32",), "batch/SpoonScoop", together, "SpoonScoop", 4, workers=1, randomize="wide", obs=SENSES),
    *case_of(("f32",), "batch/DoseSpoon", together, "DoseSpoon", 3, workers=1),
    *case_of(("f32",), "batch/two processes", together, "SpoonPour", 3, num_envs=2, workers=2),
    *case_of(("ieee",), "env/SpoonPour", act, "SpoonPour", 4),
    *case_of(("ieee",), "arm/SpoonScoop", act, "SpoonScoop", 2, arm=True),
    *case_of(("threads",), "env/ShovelMove", act, "ShovelMove", 3),
]
