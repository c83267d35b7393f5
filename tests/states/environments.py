"""Cases of environments: every bundled task with the tool alone and with an arm, senses, random scenes, batches."""

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from groups import case_of
from internals import dosing_terms, keep_solver, policy_action, solver_of, vector_solvers
from keep import Keep

import robosim  # noqa: F401  (registers the environments)

SENSES = ["tool", "wrist", "height_map", "grains", "goal", "time", "scale", {"name": "depth", "noise_model": "stereo"}]
ARM_SENSES = ["joints", "torques", "tool", "wrist", "height_map", {"name": "depth", "camera": "hand_wrist"}]


def step(keep: Keep, env: Any, action: np.ndarray) -> bool:
    """Take a step, and keep what it returns; returns whether an episode has ended."""
    found = dict(zip(("observation", "reward", "terminated", "truncated", "info"), env.step(action)))
    for name, value in found.items():
        keep(name, value)
    return bool(np.any(found["terminated"] | found["truncated"]))


def random_actions(env: Any, steps: int) -> Iterator[np.ndarray]:
    """Yield actions of up to 0.6 of their bounds."""
    rng = np.random.default_rng(7)
    for _ in range(steps):
        yield (0.6 * rng.uniform(-1.0, 1.0, env.action_space.shape)).astype(np.float32)


def act(keep: Keep, task: str, steps: int, **options: Any) -> None:
    env = gymnasium.make(f"robosim/{task}-v0", **options)
    for name, value in zip(("observation", "info"), env.reset(seed=0)):
        keep(name, value)
    keep("start", solver_of(env).state())  # a ledger is left from what was before
    for action in random_actions(env, steps):
        step(keep, env, action)
    keep_solver(keep, solver_of(env))
    env.close()


def together(keep: Keep, task: str, steps: int, num_envs: int = 3, **options: Any) -> None:
    env = gymnasium.make_vec(f"robosim/{task}-v0", num_envs=num_envs, **options)
    for name, value in zip(("observation", "info"), env.reset(seed=5)):
        keep(name, value)
    for actions in random_actions(env, steps):
        step(keep, env, actions)
    for solver in vector_solvers(env):
        keep("grains", solver.state())
    env.close()


def perform(keep: Keep, task: str, most: int = 10_000, policy: str = "scripted", **options: Any) -> None:
    """Run the scripted motion of a task, or a controller of its dose, from the nominal start."""
    obs = {} if policy == "scripted" else {"obs": dosing_terms()}
    env = gymnasium.make(f"robosim/{task}-v0", **obs, **options)
    env.reset(seed=0, options={"nominal": True})
    action = policy_action(env, policy)
    for _ in range(most):
        if step(keep, env, action()):
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
            step(keep, env, action)
        env.unwrapped.load(state)
    env.close()


def cases_of(task: str) -> list:
    """Return the cases of a task that every one has.

    A first start that takes more than a minute to settle, and most arms, are run with --full."""
    pour, is_long = task == "SpoonPour", task in ("DoseScoop", "DoseBottle")
    with_arm = task in ("SpoonScoop", "SpoonPour", "BottlePickPour", "ShovelMove")
    return [*case_of(f"env/{task}", act, task, 5, usual="f32 f64" if pour else "" if is_long else "f32",
                     more="" if pour else "f32 f64" if is_long else "f64"),
            *case_of(f"arm/{task}", act, task, 2, arm=True, usual="f32" if with_arm else "",
                     more="f64" if with_arm else "f32 f64")]


CASES = [  # those of a task follow each other: an environment takes over the kernels of an equal one that was closed
    cases_of("SpoonPour"),
    case_of("env/SpoonPour", act, "SpoonPour", 4, more="ieee"),
    case_of("env/state", return_to, "SpoonPour", usual="f32"),
    case_of("env/senses", act, "SpoonPour", 5, obs=SENSES, latency=0.02, noise=1e-3, dropout=0.1, action_delay=0.03,
             privileged=["grains", "wrist"], usual="f32"),
    case_of("env/senses", act, "SpoonPour", 5, obs=SENSES, latency=0.02, noise=1e-3, more="f64"),
    case_of("env/flour", act, "SpoonPour", 3, material="flour", more="f32"),
    case_of("env/all grains", act, "SpoonPour", 3, obs="all", action_delay=0.01, horizon="truncate", more="f32"),
    case_of("env/moments", act, "SpoonPour", 3, obs="moments", action_repeat=25, more="f32"),
    case_of("batch/SpoonPour", together, "SpoonPour", 5, workers=1, usual="f32"),
    case_of("batch/two processes", together, "SpoonPour", 3, num_envs=2, workers=2, more="f32"),
    case_of("arm/panda", act, "SpoonPour", 3, arm=True, robot="panda", usual="f32"),
    case_of("arm/senses", act, "SpoonPour", 3, arm=True, obs=ARM_SENSES, usual="f32"),
    case_of("arm/state", return_to, "SpoonPour", arm=True, usual="f32"),
    cases_of("SpoonScoop"),
    case_of("script/SpoonScoop", perform, "SpoonScoop", usual="f32"),
    case_of("arm/script", perform, "SpoonScoop", arm=True, more="f32"),
    case_of("arm/SpoonScoop", act, "SpoonScoop", 2, arm=True, more="ieee"),
    case_of("env/wide", act, "SpoonScoop", 4, randomize="wide", usual="f32", more="f64"),
    case_of("batch/SpoonScoop", together, "SpoonScoop", 4, workers=1, randomize="wide", obs=SENSES, more="f32"),
    cases_of("DoseSpoon"),
    case_of("dose/pi", perform, "DoseSpoon", 15, "pi", usual="f32"),
    case_of("batch/DoseSpoon", together, "DoseSpoon", 3, workers=1, more="f32"),
    *map(cases_of, ("SpoonTranslate", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour", "ShovelMove",
                    "DoseScoop", "DoseBottle", "DoseShaker", "ScoopTo")),
    *(case_of(f"script/{task}", perform, task, more="f32")
      for task in ("ShovelMove", "ScoopScoop", "SpoonPour", "BottlePickPour")),
    case_of("batch/arms", together, "SpoonTranslate", 2, num_envs=2, workers=1, arm=True, more="f32"),
    case_of("arm/ur5e", act, "ShovelMove", 3, arm=True, robot="ur5e", usual="f32"),
    case_of("env/ShovelMove", act, "ShovelMove", 3, more="threads"),
    case_of("arm/wide", act, "ScoopPour", 3, arm=True, randomize="wide", more="f32"),
    case_of("arm/xarm7", act, "ScoopPour", 3, arm=True, robot="xarm7", more="f32"),
    case_of("arm/friction grasp", act, "ScoopTranslate", 3, arm=True, grasp="friction", more="f32"),
    case_of("env/point cloud", act, "ScoopScoop", 3, obs=["goal", "point_cloud", "tool"], flatten=True, more="f32"),
]
