"""The page of an environment, its docstring: made from its configuration, in the form of Gymnasium's pages."""

import numpy as np

from robosim.config.materials import load_material
from robosim.scene.grains import grain_volume
from robosim.tasks.observation import dose_terms, grain_bounds, tool_bounds
from robosim.tasks.outcome import build_reward
from robosim.tasks.sections import DosingConfig
from robosim.tasks.task import RegionConfig, TaskConfig, load_task

PAGE = """{summary}

## Description
{count} particles ({particles}) of {material}{load} and a {tool}, which the agent moves. An episode has {up_to}{steps}
steps of {step_dt} s. Each action is repeated for `action_repeat` steps, 10 by default{decisions}.
{resolution}
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
{observations}

## Rewards
The reward is the sum of these terms over the steps of an action; `info["reward_terms"]` has each term.{measured}

| Term | Per | Value |
|---|---|---|
{terms}

`info["tcs"]` is the task completion score: the sum of all terms except distance and contact over the episode.
`info["tcs_terms"]` has its parts. It is {worst:.2f} for a tool that never moves and {best:.2f} for a perfect motion.
`info["is_success"]` is True with {success}

## Starting State
The grains are at rest. {drawn}The tool's frame is at {start} m plus a random displacement of at most {spread} m along
each axis. `reset(options={{"nominal": True}})` starts without the displacement.

## Episode End
Terminated: {early}after {steps} steps, or when the simulation diverges. In the latter case `info["diverged"]` has the
reason, the reward terms have their lowest values, and the observation is the last finite one.
Truncated: with `horizon="truncate"`, after {steps} steps.

## Arguments
| Argument | Default | Meaning |
|---|---|---|
| `material` | "{material}" | name of a material in configs/materials, or the path of a .yaml file |
| `action_repeat` | 10 | number of steps for which an action is repeated |
| `obs` | {obs} | layout of the observation, or a list of terms of sensors such as `["tool", "wrist", "depth"]` |
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
FLAT = """`Box(({size},), float32)` with `obs="flat"`; `env.unwrapped.observation_slices` names the parts. World frame.

| Num | Observation | Min | Max | Unit |
|---|---|---|---|---|
{rows}

Other values of `obs`: "dict" (a `Dict` of particles, tool and time), "moments" (statistics of all grains), "positions",
"velocities", "none" (no grains) and "all" (every grain)."""
DOSED = """A `Dict` of the terms {terms}, or any others that `obs` lists; `target` is the mass to dose [kg].
The layouts of the other tasks, such as "flat", are accepted, too; they have the target before the time."""


def build_page(name: str) -> str:
    """Write the page of a sub-task, by name or file. Raises ConfigError for a file that cannot be used."""
    task = load_task(name)
    reward = build_reward(task)
    worst, best = reward.extremes()
    own = _delivery_words(task) if task.dose is None else _dose_words(task, task.dose)
    return PAGE.format(
        summary=task.description[0].upper() + task.description[1:] + ".", name=name, material=task.material,
        tool=task.tool_name, count=task.grains.count, steps=task.steps, step_dt=task.step_dt, n=task.action.size,
        shaking="" if task.action.vibration is None else ", and a vibration that is added to its pose",
        lower=task.action.lower, upper=task.action.upper, actions=_table(_action_rows(task)), worst=worst, best=best,
        terms=_table([(key, *term.row(reward.scene)) for key, term in reward.terms.items()]),
        start=task.start.position, spread=task.start.spread, **own)


def _delivery_words(task: TaskConfig) -> dict[str, str]:
    (observations, size), success = _observation_rows(task), task.success
    assert success is not None
    turned = f" and the tool rotated to within {success.turn_error_deg:g} deg" if success.turn_error_deg else ""
    return {"particles": "grains", "load": "", "up_to": "", "resolution": "", "measured": "", "drawn": "", "early": "",
            "decisions": f", so an episode has {-(-task.steps // 10)} actions", "obs": '"flat"',
            "observations": FLAT.format(size=size, rows=_table(observations)),
            "success": f"{success.delivered:.0%} of {task.grains.counted} grains on the target{turned}.\nTarget: "
                       f"{_region(task.target)}. A grain is lost outside {_region(task.bounds)}, unless the tool holds "
                       f"it."}


def _dose_words(task: TaskConfig, dose: DosingConfig) -> dict[str, str]:
    point, pours = 1e3 * load_material(task.material).density.value * grain_volume(task), task.receiver is not None
    terms = ", ".join(f"`{term}`" for term in dose_terms(task))
    measured = "the mass in the receiver" if pours else "the mass in the tool"
    spilled = "what lies beside the receiver" if pours else f"what is outside {_region(task.bounds)}"
    clear = "" if pours else ", and 20 mm or more away from the container"
    return {"particles": "material points", "up_to": "up to ", "decisions": "", "obs": terms,
            "load": f", {task.grains.count * point:.3g} g in the {'tool' if task.carried else task.container},",
            "resolution": f"\nOne material point weighs {point:.3g} g of {task.material}: no reading of a mass is "
                          f"finer, and no result has a smaller error.\n",
            "measured": f" m is {measured}.", "observations": DOSED.format(terms=terms),
            "success": f"m within {dose.tolerance_percent:g} % or {dose.tolerance_g:g} g of the target, whichever is "
                       f"more.\n`info[\"readings\"]`: `poured` (m), `target_mass`, `dose_error`, `overshoot`, "
                       f"`spilled`, `held` and `elsewhere` in kg,\n`dose_error_percent`, and `seconds`. Spilled "
                       f"is {spilled}.",
            "drawn": f"The target is drawn between {dose.target_g[0]:g} and {dose.target_g[1]:g} g, each mass as "
                     f"likely as any other; `randomize={{\"target_mass\": (0.01, 0.01)}}` [kg] gives another range, "
                     f"or one mass. ",
            "early": f"when the tool is level again, to within 2 deg, for 0.5 s after it was tilted by more than 5 deg"
                     f"{clear}, "}


def _table(rows: list[tuple[object, ...]]) -> str:
    return "\n".join(f"| {' | '.join(map(str, row))} |" for row in rows)


def _action_rows(task: TaskConfig) -> list[tuple[object, ...]]:
    action, vibration = task.action, task.action.vibration
    units = [(f"velocity along {axis}", f"{action.speed} m/s") for axis in "xyz"]
    units += [(f"angular velocity about {axis}", f"{action.angular_speed} rad/s")
              for axis in "xyz"[: action.dimensions - 3]]
    rows: list[tuple[object, ...]] = [(k, quantity, f"-{unit}", unit) for k, (quantity, unit) in enumerate(units)]
    if vibration is not None:
        rows += [(len(rows), f"amplitude of a vibration along the tool's {vibration.axis}", "0 m",
                  f"{vibration.amplitude:g} m"),
                 (len(rows) + 1, "its frequency", *(f"{value:g} Hz" for value in vibration.frequency))]
    return rows


def _observation_rows(task: TaskConfig) -> tuple[list[tuple[object, ...]], int]:
    """Return the rows of the table of observations, and the number of entries of one."""
    field, n = task.field, task.grains.count // task.grains.observe_every
    grid = field.grid
    lower, upper = grain_bounds(grid)
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
    return f"({', '.join(f'{value:.3g}' for value in values)})"


def _region(region: RegionConfig) -> str:
    shape = "cylinder" if region.round else "box"
    return f"a {shape} about {region.centre} m with half sizes {region.half} m"
