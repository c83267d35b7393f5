"""The page of an environment, its docstring: made from the configuration that the environment runs on.

Headings and tables follow Gymnasium's environment pages.
"""

import numpy as np

from robosim.config.materials import load_material
from robosim.rewards.reward import Reward
from robosim.scene.field import largest_step
from robosim.scene.grains import grain_volume
from robosim.tasks.observation import DOSING_TERMS, SCOOPING_TERMS, grain_bounds, tool_bounds
from robosim.tasks.outcome import build_reward
from robosim.tasks.sections import DosingConfig
from robosim.tasks.task import RegionConfig, TaskConfig, load_task

PAGE = """{summary}

## Description
{count} particles (grains) of {material} and a {tool}, which the agent moves. An episode has {steps} steps of
{step_dt} s. Each action is repeated for `action_repeat` steps, 10 by default, so an episode has {decisions} actions.

```python
import gymnasium, robosim
env = gymnasium.make("robosim/{name}-v0")
```

## Action Space
`Box(-1, 1, ({n},), float32)`: velocities of the tool in world axes, z up. The origin of the tool's frame stays in the
box from {lower} m to {upper} m.

| Num | Action | Min | Max | Unit of 1 |
|---|---|---|---|---|
{actions}

## Observation Space
`Box(({size},), float32)` with `obs="flat"`; `env.unwrapped.observation_slices` names the parts. World frame.

| Num | Observation | Min | Max | Unit |
|---|---|---|---|---|
{observations}

Other values of `obs`: "dict" (a `Dict` of particles, tool and time), "moments" (statistics of all grains), "positions",
"velocities", "none" (no grains) and "all" (every grain).

## Rewards
The reward is the sum of these terms over the steps of an action; `info["reward_terms"]` has each term.

| Term | Per | Value |
|---|---|---|
{terms}

`info["tcs"]` is the task completion score: the sum of all terms except distance and contact over the episode.
`info["tcs_terms"]` has its parts. It is {worst:.2f} for a tool that never moves and {best:.2f} for a perfect motion.
`info["is_success"]` is True with {success}.
Target: {target}. A grain is lost outside {bounds}, unless the tool holds it.

## Starting State
The grains are at rest. The tool's frame is at {start} m plus a random displacement of at most {spread} m along each
axis. `reset(options={{"nominal": True}})` starts without the displacement.

## Episode End
Terminated: after {steps} steps, or when the simulation diverges. In the latter case `info["diverged"]` has the reason,
the reward terms have their lowest values, and the observation is the last finite one.
Truncated: with `horizon="truncate"`, after {steps} steps.

## Arguments
| Argument | Default | Meaning |
|---|---|---|
| `material` | "{material}" | name of a material in configs/materials, or the path of a .yaml file |
| `action_repeat` | 10 | number of steps for which an action is repeated |
| `obs` | "flat" | layout of the observation, or a list of terms of sensors such as `["tool", "wrist", "depth"]` |
| `flatten` | False | True: one array of the terms instead of a dictionary |
| `latency`, `noise`, `dropout` | 0 | age [s], white noise and lost readings of all terms of sensors |
| `action_delay` | 0 | time [s] by which actions are carried out later |
| `privileged` | () | terms of `info["privileged"]` |
| `horizon` | "terminate" | "terminate" or "truncate": how an episode of full length ends |
| `clip_actions` | False | True: clip actions to -1 to 1; False: an action outside raises ConfigError |
| `randomize` | None | what every episode draws: name -> (lowest, highest), or "nominal" or "wide" |
| `arm` | False | True: the whole arm carries the tool, with two-way coupling |
| `tool` | None | another tool: its name, the path of its .yaml file, or a ToolConfig |
| `robot`, `gripper` | None | with `arm=True`: names or files of another arm and hand |
| `grasp` | "weld" | "weld" or "friction": how the arm's hand holds the tool |
| `render_mode` | None | "rgb_array" or "human" |
| `camera` | "task" | "task", "side", "overview" or "close" |
| `task` | None | a TaskConfig or the path of a task file, with the same tool and terms of the reward |
| any parameter of the material | the material's | such as `E=2e5` [Pa] or `friction_angle_deg=25.0` |

## Version History
* v0: initial version
"""


DOSE_PAGE = """{summary}

## Description
{count} particles (material points) of {material}, {load}, and a {tool}, which the agent moves. An episode has up to
{steps} steps of {step_dt} s. Each action is repeated for `action_repeat` steps, 10 by default.

One material point weighs {point:.3g} g of {material}: no reading of a mass is finer, and no result has a smaller error.

```python
import gymnasium, robosim
env = gymnasium.make("robosim/{name}-v0")
```

## Action Space
`Box(-1, 1, ({n},), float32)`: velocities of the tool in world axes, z up{shaking}. The origin of the tool's frame stays
in the box from {lower} m to {upper} m.

| Num | Action | At -1 | At 1 |
|---|---|---|---|
{actions}

## Observation Space
A `Dict` of the terms {terms}, or any others that `obs` lists; `target` is the mass to dose [kg].
The layouts of the other tasks, such as "flat", are accepted, too; they have the target before the time.

## Rewards
The reward is the sum of these terms over the steps of an action; `info["reward_terms"]` has each term, `info["tcs"]`
their sum over the episode. m is {measured}.

| Term | Per | Value |
|---|---|---|
{rewards}

`info["tcs"]` is {worst:g} for a tool that never moves and at most {best:g}.
`info["is_success"]` is True where m is within {percent:g} % or {grams:g} g of the target, whichever is more.
`info["readings"]`: `poured` (m), `target_mass`, `dose_error`, `overshoot`, `spilled`, `held` and `elsewhere` in kg,
`dose_error_percent`, and `seconds`. Spilled is {spilled}.

## Starting State
The grains are at rest. The target is drawn between {low:g} and {high:g} g, each mass as likely as any other;
`randomize={{"target_mass": (0.01, 0.01)}}` [kg] gives another range, or one mass. The tool's frame is at {start} m
plus a random displacement of at most {spread} m along each axis.

## Episode End
Terminated: when the tool is level again, to within 2 deg, for 0.5 s after it was tilted by more than 5 deg{clear};
after {steps} steps; or when the simulation diverges. In the last case `info["diverged"]` has the reason.
Truncated: with `horizon="truncate"`, after {steps} steps.

## Arguments
Those of the other tasks, with `obs` = {terms} by default.

## Version History
* v0: initial version
"""


def build_page(name: str) -> str:
    """Write the page of a sub-task, by name or file. Raises ConfigError for a file that cannot be used."""
    task = load_task(name)
    if task.dose is not None:
        return _build_dose_page(name, task, task.dose)
    reward = build_reward(task)
    worst, best = reward.extremes()
    observations, size = _observation_rows(task)
    return PAGE.format(
        summary=task.description[0].upper() + task.description[1:] + ".", name=name, material=task.material,
        tool=task.tool_name, count=task.grains.count, steps=task.steps, step_dt=task.step_dt,
        decisions=-(-task.steps // 10), n=task.action.dimensions, lower=task.action.lower, upper=task.action.upper,
        actions=_table(_action_rows(task)), observations=_table(observations), size=size,
        terms=_table(_term_rows(reward)), worst=worst, best=best, success=_success(task), start=task.start.position,
        spread=task.start.spread, target=_region(task.target), bounds=_region(task.bounds))


def _build_dose_page(name: str, task: TaskConfig, dose: DosingConfig) -> str:
    """Write the page of a dosing task."""
    density, volume, pours = load_material(task.material).density.value, grain_volume(task), task.receiver is not None
    reward = build_reward(task)
    worst, best = reward.extremes()
    terms = DOSING_TERMS if pours else SCOOPING_TERMS
    mass = 1e3 * task.grains.count * density * volume
    rows: list[tuple[object, ...]] = [(k, quantity, f"-{unit}", unit) for k, quantity, _, _, unit in _action_rows(task)]
    vibration, n = task.action.vibration, task.action.dimensions
    if vibration is not None:
        low, high = vibration.frequency
        largest = f"{vibration.amplitude:g} m"
        rows += [(n, f"amplitude of a vibration along the tool's {vibration.axis}", "0 m", largest),
                 (n + 1, "its frequency", f"{low:g} Hz", f"{high:g} Hz")]
    return DOSE_PAGE.format(
        summary=task.description[0].upper() + task.description[1:] + ".", name=name, material=task.material,
        tool=task.tool_name, count=task.grains.count, steps=task.steps, step_dt=task.step_dt, n=task.action.size,
        load=f"{mass:.3g} g in the {'tool' if task.carried else task.container}", point=1e3 * density * volume,
        shaking=", and a vibration that is added to its pose" if vibration is not None else "",
        lower=task.action.lower, upper=task.action.upper, actions=_table(rows),
        terms=", ".join(f"`{term}`" for term in terms),
        measured="the mass in the receiver" if pours else "the mass in the tool",
        rewards=_table(_term_rows(reward)), worst=worst, best=best,
        percent=dose.tolerance_percent, grams=dose.tolerance_g,
        spilled="what lies beside the receiver" if pours else f"what is outside {_region(task.bounds)}",
        low=dose.target_g[0], high=dose.target_g[1], start=task.start.position, spread=task.start.spread,
        clear="" if pours else ", and 20 mm or more away from the container")


def _table(rows: list[tuple[object, ...]]) -> str:
    """Format the rows of a table."""
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _action_rows(task: TaskConfig) -> list[tuple[object, ...]]:
    """Return the rows of the table of actions."""
    action = task.action
    rows = [(f"velocity along {axis}", f"{action.speed} m/s") for axis in "xyz"]
    rows += [(f"angular velocity about {axis}", f"{action.angular_speed} rad/s")
             for axis in "xyz"[: action.dimensions - 3]]
    return [(k, quantity, -1, 1, unit) for k, (quantity, unit) in enumerate(rows)]


def _observation_rows(task: TaskConfig) -> tuple[list[tuple[object, ...]], int]:
    """Return the rows of the table of observations, and the number of entries of one."""
    field, n = task.field, task.grains.count // task.grains.observe_every
    grid = field.grid
    lower, upper = grain_bounds(grid, largest_step(task, load_material(task.material).make_law()))
    tool = tool_bounds(task, grid)
    begin = 6 * n
    rows: list[tuple[object, ...]] = [
        ("6 k to 6 k + 2", f"position of grain k, of {n} of {task.grains.count} grains",
         _vector(lower[:3]), _vector(upper[:3]), "m"),
        ("6 k + 3 to 6 k + 5", "velocity of grain k", _vector(lower[3:]), _vector(upper[3:]), "m/s"),
        (f"{begin} to {begin + 2}", "position of the tool's frame", _vector(tool[0][:3]), _vector(tool[1][:3]), "m")]
    if task.action.dimensions == 6:
        rows.append((f"{begin + 3} to {begin + 6}", "its quaternion (w, x, y, z)", "-1.01", "1.01", "1"))
    size = begin + len(tool[0]) + 1
    return [*rows, (size - 1, "share of the episode that is over", 0, 1, "1")], size


def _vector(values: np.ndarray) -> str:
    """Format a vector with three digits."""
    return f"({', '.join(f'{value:.3g}' for value in values)})"


def _success(task: TaskConfig) -> str:
    """Describe what counts as success."""
    assert task.success is not None
    words = f"{task.success.delivered:.0%} of {task.grains.counted} grains on the target"
    if task.success.turn_error_deg is not None:
        words += f" and the tool rotated to within {task.success.turn_error_deg:g} deg"
    return words


def _term_rows(reward: Reward) -> list[tuple[object, ...]]:
    """Return the rows of the table of rewards."""
    return [(name, *term.row(reward.scene)) for name, term in reward.terms.items()]


def _region(region: RegionConfig) -> str:
    """Describe a region."""
    shape = "cylinder" if region.round else "box"
    return f"a {shape} about {region.centre} m with half sizes {region.half} m"
