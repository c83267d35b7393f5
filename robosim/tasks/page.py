"""The page of an environment: its docstring, made of the same configuration that the code runs on."""

from robosim.tasks.reward import Reward
from robosim.tasks.task import RegionConfig, TaskConfig, load_task

PAGE = """{description}

    env = gymnasium.make("robosim/{name}-v0", material="{material}")

An episode is {steps} steps of {step_dt} s; an action is held for `action_repeat` (default 10) of them.

Action: Box(-1, 1, ({n},)), velocities of the tool in world axes.

| component | 1 means |
|---|---|
{actions}

Observation (obs="flat"): float32; `env.unwrapped.observation_slices` tells what stands where. Positions [m] and
velocities [m/s] of {observed} of {count} grains, the tool's {pose}, the share of the episode that has passed.
Other layouts: "dict", "moments", "positions", "velocities", "none", "all".

Reward: the sum of the terms below over the steps of a held action; `info["reward_terms"]` has each.
`info["tcs"]`, `info["tcs_terms"]`: the score so far, without distance and contact.

| term | per | value |
|---|---|---|
{terms}

Score of a tool that never moves {worst:.2f}, of a perfect motion {best:.2f}. Success: {success}.
Start: the tool at {start} m, {spread}; grains settled, {material} unless `material` says otherwise.
Target: {target}. Lost grains: outside {bounds}.
"""


def page(name: str) -> str:
    """The text for a sub-task."""
    task = load_task(name)
    worst, best = Reward(task).extremes()
    n = task.action.dimensions
    rows = [f"| {axis} | {task.action.speed} m/s |" for axis in "xyz"]
    rows += [f"| turn about {axis} | {task.action.angular_speed} rad/s |" for axis in "xyz"[: n - 3]]
    success = f"{task.success.delivered:.0%} of {task.grains.counted} grains on the target"
    if task.success.turn_error_deg is not None:
        success += f", turned to within {task.success.turn_error_deg:g} deg"
    return PAGE.format(
        name=name, description=task.description[0].upper() + task.description[1:] + ".", material=task.material,
        steps=task.steps, step_dt=task.step_dt, n=n, actions="\n".join(rows), count=task.grains.count,
        observed=task.grains.count // task.grains.observe_every, worst=worst, best=best, success=success,
        pose="position" if n == 3 else "position and quaternion (w, x, y, z)", terms="\n".join(_terms(task)),
        start=task.start.position, spread=f"displaced at random by at most {task.start.spread} m",
        target=_region(task.target), bounds=_region(task.bounds))


def _terms(task: TaskConfig) -> list[str]:
    """Rows of the table of rewards."""
    weights, n, distance = task.reward, task.grains.counted, task.reward.distance
    reward = Reward(task)
    which = "grains closest to the goal" if task.grains.elites else "observed grains"
    rows = [f"| distance | step | {reward.beta:.4g} ({reward.gamma:.4g} - sum over the {n} {which} of "
            f"{distance.weights} . abs(x - {task.goal})) |"]
    if task.kind == "pour":
        return [*rows, f"| target | grain that leaves the bounds | +{weights.target} over the target, else "
                f"-{weights.target} |", f"| poured | grain, last step | +{weights.poured} outside the bounds, else "
                f"-{weights.poured} |"]
    rows += [f"| lost | grain that leaves the bounds | {weights.lost} |",
             f"| target | grain of the {n}, last step | +{weights.target} on the target, else -{weights.target} |"]
    if weights.turn is not None:
        turn = weights.turn
        rows += [f"| contact | grain that touches the tool, step | +{weights.contact} |",
                 f"| collision | step in which the tool hits the container | {weights.collision} |",
                 f"| turn | last step | {turn.scale:g} ({turn.margin:g} - abs(angle - {turn.angle_deg:g} deg), rad) |"]
    return rows


def _region(region: RegionConfig) -> str:
    """A region in words."""
    shape = "cylinder" if region.round else "box"
    return f"a {shape} about {region.centre} m with half sizes {region.half} m"
