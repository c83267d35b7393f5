"""Cases of differentiable rollouts."""

from typing import Any

import gymnasium
import numpy as np
from fields import LAWS, SAND, at, block, box
from groups import BOTH, case_of
from internals import goal_loss, keep_gradients, keep_solver, solver_of
from keep import Keep
from scenes import shape_of

import mpm
import robosim  # noqa: F401  (registers the environments)


def roll(keep: Keep, shape: str, *laws: Any, **options: Any) -> None:
    """A tool passes through blocks on the floor; the loss is their distance from a place."""
    bodies = [block(law, (0.03, 0.02 + 0.03 * k, 0.0), (0.06, 0.05 + 0.03 * k, 0.03), (0.0, 0.0, 0.0))
              for k, law in enumerate(laws)]
    tool = mpm.Collider(shape_of(shape), friction=0.3, pose=at(0.0251, 0.0403, 0.0357))
    post = mpm.Collider(mpm.Sdf.sphere(0.012), friction=0.2, static=True, pose=at(0.08, 0.04, 0.0))
    rest = {name: options.pop(name) for name in ("contact", "transfer_interval") if name in options}
    with box(*bodies, colliders=[tool, post], **rest) as solver:
        solver.advance(0.01)
        path = mpm.Rollout(solver, 12, step_dt=5 * solver.dt, **options)
        linear, angular = np.tile([0.25, 0.02, -0.02], (12, 1)), np.tile([0.3, 0.8, 0.5], (12, 1))
        loss = goal_loss((0.09, 0.05, 0.02))
        value, gradient = path.value_and_grad(linear, angular, loss)
        keep("value", value)
        keep("gradient", gradient)
        keep_gradients(keep, path)
        keep_solver(keep, solver)
        path.restart()
        keep("value", path.value(linear, angular, loss))
        path.close()


def learn(keep: Keep, task: str, steps: int) -> None:
    """The gradient of a task's objective over the first steps of an episode, with the tool at rest and moving."""
    env = gymnasium.make(f"robosim/{task}-v0")
    env.reset(seed=0)
    path, loss = env.unwrapped.rollout(steps, materials=True), env.unwrapped.objective()
    for speed in (0.0, 0.05):
        value, gradient = path.value_and_grad(np.full((steps, 3), speed), np.full((steps, 3), 10 * speed), loss)
        keep("value", value)
        keep("gradient", gradient)
        keep_gradients(keep, path)
    keep_solver(keep, solver_of(env))
    path.close()
    env.close()


CASES = case_of(("f64",), "rollout/sand", roll, "mesh", SAND, materials=True)
MORE = [
    *case_of(("f64",), "rollout/sand and fluid", roll, "mesh", SAND, LAWS["fluid"], materials=True),
    *case_of(("f64",), "rollout/bowl", roll, "bowl", SAND),
    *case_of(("f32",), "rollout/SpoonPour", learn, "SpoonPour", 10),
    *case_of(BOTH, "rollout/clay", roll, "mesh", LAWS["clay"], contact="touching"),
    *case_of(BOTH, "rollout/hencky", roll, "mesh", LAWS["hencky"], limit=1e3, window=4),
    *case_of(("f64",), "rollout/corotated", roll, "mesh", LAWS["corotated"], svd=False),
    *case_of(("f64",), "rollout/mu(I)", roll, "mesh", LAWS["mu(I)"], soft=0.1, materials=True),
    *case_of(("f64",), "rollout/svd", roll, "mesh", SAND, svd=True, budget=2_000_000),
    *case_of(("f64",), "rollout/fluid by cells", roll, "mesh", LAWS["fluid by cells"]),
    *case_of(("ieee",), "rollout/sand", roll, "mesh", SAND, materials=True),
    *case_of(("f32",), "rollout/SpoonScoop", learn, "SpoonScoop", 10),
]
