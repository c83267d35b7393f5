"""`robosim demo`: demonstrations by descent through the field (arXiv 2406.09178, Algorithm 2), or by CMA-ES."""

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

import mpm
from policies.demonstrations import RATE
from policies.demonstrations.action_repeat import Hold
from policies.demonstrations.curves import draw
from policies.demonstrations.generator import FLUID, STAND_INS, Maker, Wanted, make_some, played
from policies.demonstrations.workers import pool
from policies.learning.environments import made
from policies.learning.files import claim, write_json

SCRIPT = "script"


def demonstrate(task: str, out: Path, *, n: int = 10, material: str | None = None, iterations: int = 150,
                rate: float = RATE, hold: int = 10, start: str | Path | None = None, limit: float | None = None,
                seed: int = 0, until: float | None = None, jobs: int = 1, method: str = "descent", arm: bool = False,
                arm_weight: float = 0.0, film: bool = True, nominal: bool = False) -> int:
    """Make demonstrations 0 .. n - 1 into a folder, with their table, curves and films; returns 0."""
    for name, number in (("--n", n), ("--iterations", iterations), ("--action-repeat", hold), ("--jobs", jobs)):
        if number < 1:
            raise mpm.InvalidValue(f"{name} {number}; accepted: 1 or more")
    if seed < 0 or not 0 < rate <= 1 or not 0 <= arm_weight < np.inf:
        raise mpm.InvalidValue(f"--seed {seed}, --rate {rate}, --arm-weight {arm_weight}; accepted: 0 or more, above 0 "
                               f"up to 1, 0 or more")
    sand: Any = made(task, action_repeat=hold).unwrapped
    first = first_actions(start, until, sand.task, Hold(sand.task, hold))
    ends = sand.task.step_dt * np.minimum(hold * np.arange(1, len(first) + 1), sand.task.steps)
    kept = 0 if until is None else int(np.sum(ends <= until + 1e-9))
    if until is not None and not 0 < kept < len(first):
        raise mpm.InvalidValue(f"--until {until}; accepted: {ends[0]:g} to {ends[-2]:g} s with --action-repeat {hold}")
    stand_in = material or STAND_INS.get(sand.task.kind, FLUID)
    wanted = Wanted(sand.source, out, stand_in, first, kept, method, iterations, rate, hold, limit, arm_weight, seed,
                    nominal)
    lock = claim(out)
    try:
        if jobs > 1:
            shares = [range(i, n, jobs) for i in range(min(jobs, n))]
            with pool(len(shares)) as workers:
                list(workers.map(make_some, [wanted] * len(shares), shares))
        tabulate(wanted, n, sand, arm=arm)
        draw(out, wanted.name, n)
        for k in range(n if film else 0):
            filmed(wanted, k)
    finally:
        lock.release()
    print(out / "demonstrations.json")
    return 0


def tabulate(wanted: Wanted, n: int, sand: Any, *, arm: bool) -> None:
    """Write demonstrations.json: what each of the first n, made where it is not yet, does in its own material, in the
    environment `sand` and, if asked, with the arm."""
    maker, rows = Maker(wanted), []
    carried = wanted.environment(arm=True) if arm else None
    for k in range(n):
        found = maker.make(k)
        reset = wanted.start(k)
        row = {"demonstration": wanted.path(k).name, "start": reset, "loss": float(found["losses"].min()),
               "iterations": len(found["losses"]), "check": found["check"].tolist()}
        readings = {f"in {wanted.material}": played(maker.env, found["actions"], reset),
                    f"among grains of {sand.task.material}": played(sand, found["actions"], reset)}
        if carried is not None:
            try:
                row["asked of the arm"] = asked_of_the_arm(maker, reset, found["actions"])
                readings["with the arm"] = played(carried, found["actions"], reset) | carried.carrier.arm_readings
            except ValueError as error:  # its start is out of reach
                row["asked of the arm"] = str(error)
        rows.append(row | readings)
        write_json(wanted.out / "demonstrations.json", {"task": wanted.name, "material": wanted.material,
                                                        "method": wanted.method, "demonstrations": rows})
        tell(row, readings)


def asked_of_the_arm(maker: Maker, start: dict[str, Any], actions: np.ndarray) -> dict[str, float]:
    """What a motion from a start asks of the arm's joints; see `robosim.envs.reach.Reach.readings`."""
    maker.env.reset(**start)
    pose = maker.env.solver.collider_pose(0)
    maker.hold.begin(pose.position)
    return maker.reach.readings(pose, *maker.hold.twists(actions))


def tell(row: dict[str, Any], readings: dict[str, dict[str, float]]) -> None:
    """Print a demonstration's figures."""
    print(f"{row['demonstration']}: loss {row['loss']:.4g}")
    for where, values in readings.items():
        print(f"  {where}: delivered {values['delivered']:.2f}, score {values['tcs']:.2f}")
    if row["check"]:
        print(f"  derivative along itself {row['check'][0][0]:.4g}, by differences {row['check'][0][1]:.4g}")
    if "asked of the arm" in row:
        asked = row["asked of the arm"]
        print("  " + (asked if isinstance(asked, str) else
                      ", ".join(f"{name} {value:.3g}" for name, value in asked.items())))


def filmed(wanted: Wanted, k: int) -> None:
    """demonstration_k.mp4: the motion among the task's own grains; a film that cannot be made is said so, no more."""
    film = wanted.path(k).with_suffix(".mp4")
    if film.is_file() and film.stat().st_mtime >= wanted.path(k).stat().st_mtime:
        return
    with tempfile.TemporaryDirectory(dir=wanted.out) as folder:
        start = wanted.start(k)
        words = ["evaluate", wanted.task, "--policy", str(wanted.path(k)), "--episodes", "1", "--seed",
                 str(start["seed"]), "--out", folder, *(["--nominal"] if start["options"]["nominal"] else [])]
        ended = subprocess.run([sys.executable, "-m", "robosim", *words], capture_output=True, text=True,
                               check=False)
        made = Path(folder) / "episode.mp4"
        if ended.returncode == 0 and made.is_file():
            made.replace(film)
        else:
            print(f"no film of {wanted.path(k).name}: {(ended.stderr.strip().splitlines() or ['?'])[-1]}",
                  file=sys.stderr)


def first_actions(start: str | Path | None, until: float | None, task: Any, hold: Hold) -> np.ndarray:
    """Actions to begin with: none, those of a file, or the task's script up to a time [s]."""
    end = task.steps * task.step_dt
    if until is not None and (str(start) != SCRIPT or not 0 < until <= end):
        raise mpm.InvalidValue(f"--until {until}; accepted: with --from {SCRIPT}, above 0 up to {end:g} s")
    if start is None:
        return np.zeros(hold.shape)
    return hold.follow(task, until or end) if str(start) == SCRIPT else actions_of(Path(start), hold)


def actions_of(path: Path, hold: Hold) -> np.ndarray:
    """Actions to begin with, from a file; raises InvalidValue for what is none."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            actions = np.asarray(stored["actions"], float)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile) as error:
        raise mpm.InvalidValue(f"{path}: not a .npz file with an array `actions`: {error}") from error
    if actions.shape != hold.shape or not np.all(np.abs(actions) <= 1.0):
        raise mpm.InvalidValue(f"{path}: actions have shape {actions.shape}; accepted: {hold.shape}, from -1 to 1")
    return actions
