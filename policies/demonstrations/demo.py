"""`robosim demo`: demonstrations by descent through the field (arXiv 2406.09178, Algorithm 2), or by CMA-ES."""

import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import mpm
from mpm.array_files import read_arrays
from mpm.files import temporary_path, write
from policies.demonstrations.action_repeat import ActionRepeat
from policies.demonstrations.generator import (
    DemonstrationGenerator,
    DemonstrationRequest,
    make_demonstrations,
    surrogate_material,
)
from policies.demonstrations.reading import read_actions
from policies.learning.environments import fingerprint, make_environment, score_motion
from policies.learning.options import SearchOptions, check_at_least, to_words
from robosim.base.files import write_json
from robosim.base.jobs import worker_pool
from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.base.statistics import bootstrap
from robosim.episode.play import play
from robosim.studies.policies.script import ScriptedPolicy

SCRIPT = "script"


def demonstrate(task: str, out: Path, options: SearchOptions, *, n: int = 10, jobs: int = 1, arm: bool = False,
                film: bool = True, page: Callable[[Path], object] | None = None) -> int:
    """Make demonstrations 0 to n - 1 in a folder, with their table and films; return 0, or 1 where none succeeds.
    jobs: demonstrations that are searched for at the same time. arm: whether the table has what the motion asks of the
    arm's joints. page: writes a page of the folder. Raises robosim.ConfigError where the folder cannot be used,
    mpm.InvalidValue for an option that does not fit the task, or a folder with other demonstrations."""
    check_at_least(1, {"--n": n, "--jobs": jobs})
    env: Any = make_environment(task, action_repeat=options.action_repeat).unwrapped
    actions = first_actions(options.start, options.until, env.task, ActionRepeat(env.task, options.action_repeat))
    request = DemonstrationRequest(env.source, out, options.material or surrogate_material(env.task), actions,
                                   count_fixed(options.until, env.task, options.action_repeat, len(actions)), options)
    with OutputFolder(out):
        if jobs > 1:
            shares = [range(i, n, jobs) for i in range(min(jobs, n))]
            with worker_pool(len(shares)) as pool:
                list(pool.map(make_demonstrations, [request] * len(shares), shares))
        succeeded = write_table(request, n, env, arm=arm)
        for k in range(n if film else 0):
            film_demonstration(request, k)
        if page is not None:
            page(out)
    print(out / "demonstrations.json")
    if succeeded < n:
        print(f"{succeeded} of {n} succeed in {request.material}: more may with another --seed, --iterations above "
              f"{options.iterations}, or --from {SCRIPT}", file=sys.stderr)
    return int(not succeeded)


def record_expert(task: str, out: Path, n: int, *, seed: int, **options: Any) -> int:
    """Write episodes of the script that knows the target's place as demonstrations 0 to n - 1, print their mean score.
    seed: of the first; the next one's is one higher. options: of the environment. Finished ones are kept. Returns 0.
    Raises mpm.InvalidValue for a folder with others."""
    check_at_least(1, {"--expert": n})
    env: Any = make_environment(task, **options).unwrapped
    made_by, scores = fingerprint(env, env.action_repeat, env.world.randomization.describe(), seed), list[float]()
    with OutputFolder(out):
        for k in Progress(range(n), desc=f"{env.TASK}, expert", unit="episodes"):
            path, actions = out / f"demonstration_{k}.npz", list[np.ndarray]()
            if not path.is_file():
                env.reset(seed=seed + k)
                info = play(env, ScriptedPolicy(env, knows=True), observation=env.observation,
                            hooks=[lambda step, actions=actions: actions.append(step.action)])[1]
                write(path, partial(np.savez, actions=np.array(actions), action_repeat=env.action_repeat,
                                    task=env.TASK, start=seed + k, nominal=0, tcs=info["tcs"], fingerprint=made_by))
            stored = read_arrays(path)
            if stored.text("fingerprint", "") != made_by:
                raise mpm.InvalidValue(f"{path}: made with another task, seed or --randomize; give another --out")
            scores.append(float(stored["tcs"]))
    print("score {:.2f} ({:.2f} .. {:.2f}), {} episodes".format(np.mean(scores), *bootstrap(scores), n))
    return 0


def first_actions(start: str | Path | None, until: float | None, task: Any, motion: ActionRepeat) -> np.ndarray:
    """Return the actions (decisions, dimensions) that the search begins with; arguments as in `SearchOptions`."""
    end = task.steps * task.step_dt
    if until is not None and (str(start) != SCRIPT or not 0 < until <= end):
        raise mpm.InvalidValue(f"--until {until}; accepted: with --from {SCRIPT}, above 0 up to {end:g} s")
    if start is None:
        return np.zeros(motion.shape)
    if str(start) == SCRIPT:
        return motion.follow_script(task, until or end)
    return read_actions(Path(start), motion.decisions, motion.action_repeat, motion.dimensions).astype(float)


def count_fixed(until: float | None, task: Any, action_repeat: int, decisions: int) -> int:
    """Return how many actions end by a time [s]; raises mpm.InvalidValue where that is none or all of them."""
    if until is None:
        return 0
    ends = task.step_dt * np.minimum(action_repeat * np.arange(1, decisions + 1), task.steps)
    fixed = int(np.sum(ends <= until + 1e-9))
    if not 0 < fixed < decisions:
        raise mpm.InvalidValue(f"--until {until}; accepted: {ends[0]:g} to {ends[-2]:g} s with --action-repeat "
                               f"{action_repeat}")
    return fixed


def write_table(request: DemonstrationRequest, n: int, env: Any, *, arm: bool) -> int:
    """Write demonstrations.json for demonstrations 0 to n - 1, making those that are missing.
    Returns how many succeed in the material of the search.
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
    return sum(bool(row[f"in {request.material}"]["is_success"]) for row in rows)


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


def film_demonstration(request: DemonstrationRequest, k: int) -> None:
    """Make demonstration_k.mp4, the motion among the task's own grains, unless it is newer than the demonstration.
    Prints a line to stderr where that fails: a film is no part of the result."""
    film = request.path(k).with_suffix(".mp4")
    if film.is_file() and film.stat().st_mtime >= request.path(k).stat().st_mtime:
        return
    temporary = temporary_path(film.with_suffix(""))  # a folder, which is removed even after a kill
    temporary.mkdir()
    try:
        start = request.reset_arguments(k)
        arguments = ["evaluate", request.task, *to_words(policy=request.path(k), episodes=1, seed=start["seed"],
                                                         out=temporary, nominal=start["options"]["nominal"])]
        process = subprocess.run([sys.executable, "-m", "robosim", *arguments], capture_output=True, text=True,
                                 check=False)
        made = temporary / "episode.mp4"
        if process.returncode == 0 and made.is_file():
            made.replace(film)
        else:
            print(f"no film of {request.path(k).name}: {(process.stderr.strip().splitlines() or ['?'])[-1]}",
                  file=sys.stderr)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
