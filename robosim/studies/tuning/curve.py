"""Measurement of a pour curve: a slow tilt of the loaded tool above the receiver."""

import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.errors import ConfigError
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.base.provenance import provenance
from robosim.config.table import validate
from robosim.dosing.motion import ToolMotion
from robosim.dosing.numbers import DosingNumbers, MotionNumbers, VibrationNumbers
from robosim.dosing.pour_curve import FIRST_SHARE, PourCurve
from robosim.envs import task_name
from robosim.envs.grain_env import GrainEnv
from robosim.episode.play import continue_episode
from robosim.studies.policies.suites import Start, make_environment
from robosim.studies.policies.tool_view import ToolView, check_dosing, numbers_of, terms_of
from robosim.tasks.task import TaskConfig, load_task

STEP_DEG = 2.5
"""Tilt [deg] between two points of a curve."""
RESOLUTION = 1e-5
"""Masses [kg] of a curve are rounded to it."""
APPROACH = 3.0
"""Longest time [s] in which the lip comes to the goal before the tool tilts."""


def measure_curve(task: str, out: Path, *, episodes: int = 3, rate_deg: float = 4.0, most_deg: float = 120.0,
                  seed: int = 0, material: str | None = None) -> int:
    """Measure the pour curve of a task; write curve.json and the task's numbers with it as numbers.yaml into a folder.
    episodes: over which the curve is the mean, with the seeds from `seed` on and the task's own random starts.
    rate_deg [deg/s]: of the tilt. most_deg [deg]: last tilt. Returns 0, or 1 where a simulation diverged or too little
    left the tool for a curve. Raises ConfigError as `mean_curve`."""
    config = load_task(task)
    given = given_numbers(config, task_name(task))
    start = Start(seed, material or config.material)
    curves: list[list[tuple[float, float]]] = []
    with OutputFolder(out) as folder:
        steps = round((most_deg / rate_deg + APPROACH) / config.step_dt)
        longer = validate(config.model_dump() | {"steps": steps}, Path("curve"), TaskConfig)
        env, loads = make_environment(longer, start, obs=list(terms_of(config))), []
        for k in Progress(range(episodes), desc=f"{task_name(task)}, pour curve", unit="episodes"):
            points, load, reason = pour_slowly(env, seed + k, given.motion, rate_deg, most_deg)
            if reason:
                return _fail(folder, f"seed {seed + k}: {reason}")
            curves.append(points)
            loads.append(load)
            folder.write_json("curve.json", {"made_by": provenance(), "task": task, "material": start.material,
                                             "rate_deg": rate_deg, "loads": loads,
                                             "tilt_deg_and_poured_kg": curves})
        env.close()
        tilts, masses = mean_curve(curves, most_deg)
        load = float(np.mean(loads))
        if masses[-1] < FIRST_SHARE * load:
            return _fail(folder, f"{masses[-1] * 1e3:.2f} g of {load * 1e3:.1f} g left the tool up to {most_deg} deg")
        curve = PourCurve(material=start.material, load=round(load, 6), rate_deg=rate_deg, tilts_deg=tuple(tilts),
                          masses=tuple(masses), source=provenance()["command"])
        numbers = given.model_copy(update={"curve": curve})
        path = folder.write_yaml("numbers.yaml", numbers.model_dump(mode="json"))
    print(f"begins at {np.degrees(curve.begin):.1f} deg, {curve.most * 1e3:.1f} of {load * 1e3:.1f} g up to "
          f"{tilts[-1]:.0f} deg\n{path}")
    return 0


def _fail(folder: OutputFolder, reason: str) -> int:
    folder.failures.append(reason)
    print(f"failed: {reason}", file=sys.stderr)
    return 1


def given_numbers(config: TaskConfig, task: str) -> DosingNumbers:
    """Return a task's numbers, or those that controllers begin with where it names none.
    Raises ConfigError for a task that does not dose, or not into a receiver."""
    dose, vibration = check_dosing(config, task)
    if config.receiver is None:
        raise ConfigError(f"{task}: no empty container, into which a pour curve is poured; accepted: dosing tasks that "
                          f"pour into a receiver, as DoseSpoon does")
    if dose.controllers is not None:
        return numbers_of(config, "pour curve")
    nothing = PourCurve(material=config.material, load=1e-3, rate_deg=1.0, tilts_deg=(0.0, 90.0), masses=(0.0, 1e-3),
                        source="not measured yet")
    motion = MotionNumbers(duration=min(MotionNumbers().duration, config.steps * config.step_dt))
    return DosingNumbers(task=task, tool=config.tool_name, curve=nothing, motion=motion, vibration=VibrationNumbers(
        amplitude=vibration.amplitude, frequency=sum(vibration.frequency) / 2.0))


def pour_slowly(env: GrainEnv, seed: int, numbers: MotionNumbers, rate_deg: float,
                most_deg: float) -> tuple[list[tuple[float, float]], float, str]:
    """Tilt the tool once; return tilts [deg] with the masses poured [kg], the load [kg], and why it diverged or ""."""
    observation, _ = env.reset(seed=seed)
    load = env.carrier.setting.grain_mass * env.task.grains.count
    view, motion = ToolView(env), ToolMotion(numbers, env.action_repeat * env.task.step_dt)
    points, is_tilting = list[tuple[float, float]](), False

    def tilt_slowly(observation: Any) -> np.ndarray:
        nonlocal is_tilting
        sight = view.look(observation)
        is_tilting = motion.is_near(sight) or bool(points)
        return view.act(sight, motion.turn(sight, np.radians(rate_deg) if is_tilting else 0.0))

    for step in continue_episode(env, tilt_slowly, observation):
        if step.info.get("diverged"):
            return points, load, str(step.info["diverged"])
        tilt = float(np.degrees(view.look(step.next_observation).tilt))
        if is_tilting and rate_deg > 0.0:
            points.append((round(tilt, 4), float(step.info["readings"]["poured"])))
        if tilt >= most_deg:
            break
    return points, load, ""


def mean_curve(curves: list[list[tuple[float, float]]], most_deg: float) -> tuple[list[float], list[float]]:
    """Return tilts [deg] and the mean masses [kg] there, not falling; without the parts in which nothing is poured.
    curves: tilts [deg] with the masses poured [kg], for each episode. Raises ConfigError for an episode without any,
    and for tilts that do not rise."""
    for k, points in enumerate(curves):
        if not points:
            raise ConfigError(f"pour curve: episode {k} has no tilt: the lip was not above the cup in time; accepted: "
                              f"a start from which it comes there within {APPROACH:g} s")
        for (before, _), (tilt, _) in pairwise(points):
            if tilt <= before:
                raise ConfigError(f"pour curve: episode {k}: a tilt of {tilt:g} deg after {before:g} deg; accepted: "
                                  f"rising tilts, so a rate and a last tilt that the tool can follow")
    tilts = np.arange(0.0, most_deg + 1e-9, STEP_DEG)
    means = np.mean([np.interp(tilts, *np.array(points).T) for points in curves], axis=0)
    masses = np.round(np.maximum.accumulate(means) / RESOLUTION) * RESOLUTION
    first = max(0, int(np.searchsorted(masses, masses[0], side="right")) - 1)
    last = min(len(masses) - 1, int(np.searchsorted(masses, masses[-1])))
    if last <= first:
        first, last = 0, len(masses) - 1
    return [float(t) for t in tilts[first:last + 1]], [round(float(m), 5) for m in masses[first:last + 1]]
