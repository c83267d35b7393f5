"""Summary of demonstrations: the table of their scores."""

from typing import Any

import numpy as np

from policies.demonstrations.generator import DemonstrationGenerator, DemonstrationRequest
from policies.learning.environments import score_motion
from robosim.base.files import write_json


def write_table(request: DemonstrationRequest, n: int, env: Any, *, arm: bool) -> None:
    """Write demonstrations.json for demonstrations 0 to n - 1, making those that are missing.
    env: the environment with the task's own material. arm: also score each motion carried out by the arm."""
    generator, rows = DemonstrationGenerator(request), []
    arm_env = request.make_environment(arm=True) if arm else None
    for k in range(n):
        demonstration = generator.make(k)
        actions, start = demonstration["actions"], request.reset_arguments(k)
        row = {"demonstration": request.path(k).name, "start": start, "loss": float(demonstration["losses"].min()),
               "iterations": len(demonstration["losses"]), "check": demonstration["check"].tolist()}
        scores = {f"in {request.material}": score_motion(generator.env, actions, **start),
                  f"among grains of {env.task.material}": score_motion(env, actions, **start)}
        if arm_env is not None:
            try:
                row["arm demands"] = arm_demands(generator, start, actions)
                scores["with the arm"] = score_motion(arm_env, actions, **start) | arm_env.carrier.arm_readings
            except ValueError as error:  # the arm cannot reach the start
                row["arm demands"] = str(error)
        rows.append(row | scores)
        write_json(request.out / "demonstrations.json", {"task": request.name, "material": request.material,
                                                         "method": request.options.method, "demonstrations": rows})
        print_row(row, scores)


def arm_demands(generator: DemonstrationGenerator, start: dict[str, Any], actions: np.ndarray) -> dict[str, float]:
    """Return what a motion from a start demands of the arm's joints; see `robosim.envs.reach.Reach.readings`."""
    generator.env.reset(**start)
    pose, motion = generator.env.solver.collider_pose(0), generator.loss.actions
    motion.set_start(pose.position)
    return generator.loss.reach.readings(pose, *motion.to_twists(actions))


def print_row(row: dict[str, Any], scores: dict[str, dict[str, float]]) -> None:
    """Print a demonstration's figures."""
    print(f"{row['demonstration']}: loss {row['loss']:.4g}")
    for condition, values in scores.items():
        print(f"  {condition}: delivered {values['delivered']:.2f}, score {values['tcs']:.2f}")
    if row["check"]:
        print(f"  derivative along the gradient {row['check'][0][0]:.4g}, by differences {row['check'][0][1]:.4g}")
    if "arm demands" in row:
        demands = row["arm demands"]
        print("  " + (demands if isinstance(demands, str) else
                      ", ".join(f"{name} {value:.3g}" for name, value in demands.items())))
