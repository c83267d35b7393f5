"""All accesses that are not of the public surface (`import mpm`, `import robosim`, `gymnasium.make`).

When a change renames what is used here, adapt this file alone: try the new place first, then the old one."""

from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import numpy as np
from keep import Keep

import mpm
import robosim

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


def evaluation_policies() -> Any:
    """Return the module of the policies that are evaluated; up to 732b661 it was elsewhere."""
    place = "robosim.studies.evaluation.policies"
    return import_module(place if Path(robosim.__path__[0], "studies").is_dir() else place.replace("studies.", ""))


def tool_wall() -> str:
    """Return the key of a rehearsal's wall thickness of the tool; up to 732b661 it had another name."""
    fields = robosim.RehearsalConfig.model_fields
    return "tool_wall" if "tool_wall" in fields else "collision_thickness"


def policy_action(env: Any, policy: str) -> Any:
    """Return a function that gives the next action of a task's scripted motion, or of a controller of doses."""
    act = evaluation_policies().make_policy(policy, env.unwrapped, 0)
    takes_observation = len(signature(act).parameters)  # up to 732b661 it asked the environment
    return lambda: act(*[env.unwrapped.observation][:takes_observation])


def dosing_terms() -> list[str]:
    return evaluation_policies().training_options("pi")["obs"]


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
    data = run.cell.data if hasattr(run, "cell") else run.data  # as it was called up to 732b661
    keep("qpos", data.qpos)
    keep("qvel", data.qvel)
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
    """Set the volume [m^3] of the particles of a body; up to 732b661 it was a method of the solver itself."""
    getattr(solver, "settings", solver).set_volume(index, volume)
