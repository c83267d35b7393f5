"""All accesses that are not of the public surface (`import mpm`, `import robosim`, `gymnasium.make`).

When a change renames what is used here, adapt this file alone: try the new place first, then the old one."""

from typing import Any

import numpy as np
from keep import Keep

import mpm

WALL_TIMES = ("realtime_factor", "plan_time_s", "prepare_time_s", "record_time_s", "compile_time_s", "film_wait_time_s",
              "wall_time_s")
"""Figures of a report that say how long the computer took."""


def keep_solver(keep: Keep, solver: mpm.Solver, name: str = "grains") -> None:
    """Keep the whole state of a solver, and what it has summed up in its last advance."""
    keep(name, solver.state())
    keep(f"{name}/ledger", solver.ledger)
    keep(f"{name}/momentum", solver.momentum_after_advance())


def solver_of(env: Any) -> mpm.Solver:
    return env.unwrapped.solver


def policy_action(env: Any, policy: str) -> Any:
    """Return a function that gives the next action of a task's scripted motion, or of a controller of doses."""
    from robosim.studies.evaluation.policies import make_policy

    act = make_policy(policy, env.unwrapped, 0)
    return lambda: act(env.unwrapped.observation)


def dosing_terms() -> list[str]:
    from robosim.studies.evaluation.dosing_policy import TERMS

    return list(TERMS)


def vector_solvers(env: Any) -> list[mpm.Solver]:
    return [batch.world.solver for batch in env.unwrapped.batches if hasattr(batch, "world")]


def goal_loss(goal: tuple[float, float, float]) -> Any:
    """Return a loss: the distance of the particles from a place [m]."""
    from mpm.rollout.losses import WeightedDistance

    return WeightedDistance(np.array(goal), np.array([1.0, 0.7, 1.3]))


def keep_gradients(keep: Keep, roll: mpm.Rollout) -> None:
    """Keep the derivatives of a rollout that it does not return."""
    keep("by material", roll.last.materials)
    keep("norms", roll.last.norms)


def keep_plan(keep: Keep, plan: Any) -> None:
    """Keep the motion of a planned rehearsal at times from its begin to its end, and how the tool is held."""
    times = np.linspace(0.0, plan.motion.duration, 101)
    for name in ("q", "qd", "qdd"):
        keep(f"plan/{name}", np.array([getattr(plan.motion.state(time), name) for time in times]))
    keep("plan/tool", [np.concatenate(plan.path.pose(time)) for time in times])
    keep("plan/waypoints", plan.path.times)
    keep("plan/duration", plan.motion.duration)
    keep("plan/time scale", plan.time_scale)
    keep("plan/clearance", rounded(plan.clearance.surroundings.distance))
    if plan.approach is not None:
        motion = plan.approach.motion
        keep("plan/approach", [motion.state(time).q for time in np.linspace(0.0, motion.duration, 31)])


def run_begin(keep: Keep, plan: Any, steps: int) -> None:
    """Simulate the first steps of a planned rehearsal, and keep grains, robot and readings."""
    from robosim.rehearsal.run import RehearsalRun

    run = RehearsalRun(plan, seed=0)
    keep("start", run.solver.state())
    for index in range(steps):
        run.step(index)
    keep_solver(keep, run.solver)
    keep("qpos", run.cell.data.qpos)
    keep("qvel", run.cell.data.qvel)
    for name in ("torque", "external_torque", "commanded", "reached", "wrist", "residual", "exchanged", "tool_force",
                 "tool_work"):
        keep(f"curves/{name}", run.readings.stack_steps(name))
    keep("curves/mass in tool", run.readings.stack_grains("mass_in_tool"))


def rounded(distance: float) -> float:
    """Return a distance [m] between meshes, whose last bits differ from process to process with places in memory."""
    return round(distance, 12)


def is_wall_time(line: str) -> bool:
    """Return whether a figure of a report, or a line about one, says how long the computer took."""
    return any(name in line for name in WALL_TIMES)


def set_volume(solver: mpm.Solver, index: int, volume: float) -> None:
    """Set the volume [m^3] of the particles of a body."""
    solver.settings.set_volume(index, volume)
