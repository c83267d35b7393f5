"""`robosim demo`: demonstrations by gradient descent through the field (arXiv 2406.09178, Algorithm 2)."""

import argparse
import hashlib
import json
import sys
from functools import cached_property, partial
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import gymnasium
import numpy as np
from tqdm import tqdm

import mpm
from policies.descent import Descent
from policies.files import write, write_json
from policies.hold import Hold
from policies.learning_curve import draw

STAND_INS = {"move": "clay"}
"""Material that a kind of sub-task is learnt in, where it is not the fluid below."""
FLUID = "glycerol"
"""Water splashes: derivatives by its positions grow by four orders of magnitude over a pour, glycerol's by two."""
RATE = 0.05
"""Step in actions of -1 to 1."""
CHANGE, PATIENCE = 0.05, 5
"""A loss has settled when it has changed by less than this share for more than so many iterations."""
SCRIPT = "script"
DIRECTIONS = 3
DIFFERENCE = 1e-3
"""Step in actions of the check by differences: in single precision a smaller one drowns in rounding."""
EXAMPLE = "example:\n  robosim demo SpoonTranslate --n 2 --out out/demo"


def command(commands: argparse._SubParsersAction) -> None:
    """Add `demo` to the command line."""
    run = commands.add_parser("demo", help="make demonstrations by gradient through the field", epilog=EXAMPLE,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("task", help="a sub-task, such as SpoonScoop")
    run.add_argument("--out", type=Path, required=True, help="folder for demonstrations, pictures and the table; a run "
                     "that was killed goes on where it was")
    run.add_argument("--n", type=int, default=10, help="demonstrations, from different starts (default: 10)")
    run.add_argument("--material", help="that the gradient goes through (default: glycerol, clay for the shovel)")
    run.add_argument("--iterations", type=int, default=150, help="at most, for each (default: 150)")
    run.add_argument("--rate", type=float, default=RATE, help=f"step in actions of -1 to 1 (default: {RATE})")
    run.add_argument("--hold", type=int, default=10, help="steps of 2 ms that an action is held (default: 10)")
    run.add_argument("--from", dest="start", help=".npz file with actions to begin with, or `script`: the task's own, "
                     "for a tool that must touch its material first (default: at rest)")
    run.add_argument("--until", type=float, help="with --from script: time [s] at which the tool leaves the script and "
                     "rests (default: the whole of it)")
    run.add_argument("--limit", type=float, help="cut entries of the state's derivatives in every substep, as sand's "
                     "may need (default: never)")
    run.add_argument("--seed", type=int, default=0, help="of the first start, as of the environment's reset")
    run.set_defaults(run=lambda a: demonstrate(
        a.task, a.out, n=a.n, material=a.material, iterations=a.iterations, rate=a.rate, hold=a.hold, start=a.start,
        limit=a.limit, seed=a.seed, until=a.until))


def demonstrate(task: str, out: Path, *, n: int = 10, material: str | None = None, iterations: int = 150,
                rate: float = RATE, hold: int = 10, start: str | Path | None = None, limit: float | None = None,
                seed: int = 0, until: float | None = None) -> int:
    """Make demonstrations 0 .. n - 1 into a folder, with their table and curves; returns 0."""
    for name, number in (("--n", n), ("--iterations", iterations), ("--hold", hold)):
        if number < 1:
            raise mpm.InvalidValue(f"{name} {number}; accepted: 1 or more")
    if seed < 0 or not 0 < rate <= 1:
        raise mpm.InvalidValue(f"--seed {seed}, --rate {rate}; accepted: 0 or more, and above 0 up to 1")
    try:
        sand: Any = gymnasium.make(f"robosim:robosim/{task}-v0", action_repeat=hold).unwrapped
    except gymnasium.error.Error as error:
        raise mpm.InvalidValue(f"task {task!r}: {error}") from error
    out.mkdir(parents=True, exist_ok=True)
    grains = sand.task.material
    stand_in = material or STAND_INS.get(sand.task.kind, FLUID)
    first = first_actions(start, until, sand.task, Hold(sand.task, hold))
    soft: Any = gymnasium.make(f"robosim:robosim/{task}-v0", material=stand_in, action_repeat=hold).unwrapped
    maker = Maker(soft, stand_in, hold, limit)
    rows = []
    for k in range(n):
        path = out / f"demonstration_{k}.npz"
        found = maker.make(path, seed + k, first, iterations, rate)
        readings = {f"in {stand_in}": played(soft, found["actions"], seed + k),
                    f"among grains of {grains}": played(sand, found["actions"], seed + k)}
        rows.append({"demonstration": path.name, "seed": seed + k, "loss": float(found["losses"].min()),
                     "iterations": len(found["losses"]), "check": found["check"].tolist(), **readings})
        write_json(out / "demonstrations.json", {"task": task, "material": stand_in, "demonstrations": rows})
        print(f"{path.name}: loss {rows[-1]['loss']:.4g}")
        for where, values in readings.items():
            print(f"  {where}: delivered {values['delivered']:.2f}, score {values['tcs']:.2f}")
        print(f"  derivative along itself {found['check'][0, 0]:.4g}, by differences {found['check'][0, 1]:.4g}")
    draw(out, task, n)
    print(f"to see one: robosim evaluate {task} --policy {out / 'demonstration_0.npz'} --episodes 1 --seed {seed} "
          f"--out FOLDER")
    return 0


def fingerprint(env: Any, *rest: object) -> str:
    """Twelve letters that change with the scene, the task, the material or anything else that is given."""
    told = json.dumps([env.task.model_dump(), env.material.model_dump(), *rest], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()[:12]


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
    except (ValueError, KeyError, EOFError, BadZipFile) as error:
        raise mpm.InvalidValue(f"{path}: not a .npz file with an array `actions`: {error}") from error
    if actions.shape != hold.shape or not np.all(np.abs(actions) <= 1.0):
        raise mpm.InvalidValue(f"{path}: actions have shape {actions.shape}; accepted: {hold.shape}, from -1 to 1")
    return actions


def stored_in(path: Path, expected: str) -> dict[str, np.ndarray] | None:
    """What an earlier run left, or None; raises InvalidValue where that was another run."""
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as stored:
        found = dict(stored)
    if str(found["fingerprint"]) != expected:
        raise mpm.InvalidValue(f"{path}: made for another scene, task, material, seed or start (fingerprint "
                               f"{found['fingerprint']}, now {expected}); give another --out, or remove it")
    return found


def played(env: Any, actions: np.ndarray, seed: int) -> dict[str, float]:
    """Score and readings of an episode with these actions."""
    env.reset(seed=seed)
    info: dict[str, Any] = {}
    for action in np.asarray(actions, np.float32):
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    return {"tcs": info["tcs"], "is_success": bool(info["is_success"]), **info["readings"]}


class Maker:
    """Makes demonstrations in one environment."""

    def __init__(self, env: Any, material: str, hold: int, limit: float | None) -> None:
        self.env, self.hold, self.material = env, Hold(env.task, hold), material
        self._told = (material, hold, limit)
        self.loss = env.objective()

    @cached_property
    def rollout(self) -> Any:
        """Laid out when it is needed."""
        return self.env.rollout(limit=self._told[-1])

    def make(self, path: Path, seed: int, first: np.ndarray, iterations: int, rate: float) -> dict[str, np.ndarray]:
        """The demonstration from the start of a seed: read if it is there, gone on with if a run was cut short."""
        mark = fingerprint(self.env, *self._told, seed, rate, first.tolist())
        beside = path.with_name(f"{path.stem}.unfinished.npz")
        found = stored_in(path, mark)
        if found is None:
            found = self._run(path, beside, mark, seed, first, iterations, rate)
        beside.unlink(missing_ok=True)
        return found

    def _run(self, path: Path, beside: Path, mark: str, seed: int, first: np.ndarray, iterations: int,
             rate: float) -> dict[str, np.ndarray]:
        self.env.reset(seed=seed)
        self.rollout.restart()
        self.hold.begin(self.env.solver.collider_pose(0).position)
        descent, losses, norms = Descent(first, rate), [], np.zeros((0, 2))
        stored = stored_in(beside, mark)
        if stored is not None:
            descent.load(stored)
            losses, norms = list(stored["losses"]), stored["norms"]
        progress = tqdm(initial=len(losses), total=iterations, desc=path.stem, file=sys.stderr)
        while len(losses) < iterations and not self.converged(losses, descent.best, seed):
            try:
                loss, gradient = self.value_and_grad(descent.now)
                if loss < descent.lowest:
                    norms = self.rollout.last.norms
                descent.step(loss, gradient)
            except (mpm.SimulationDiverged, mpm.GradientDiverged):
                if not np.isfinite(descent.lowest):  # there is no better motion to go back to
                    raise
                loss = np.inf
                descent.go_back()
            losses.append(loss)
            progress.set_postfix(loss=f"{loss:.3f}", best=f"{descent.lowest:.3f}")
            progress.update()
            kept = {"losses": np.array(losses), "norms": norms, "fingerprint": np.array(mark)}
            write(beside, partial(np.savez, **kept, **descent.state()))
        progress.close()
        found = {"actions": descent.best.astype(np.float32), "losses": np.array(losses), "norms": norms,
                 "check": self.check(descent.best), "fingerprint": np.array(mark), "seed": np.array(seed),
                 "material": np.array(self.material), "hold": np.array(self.hold.hold)}
        write(path, partial(np.savez, **found))
        return found

    def value_and_grad(self, actions: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and its derivatives by the actions."""
        loss, bars = self.rollout.value_and_grad(*self.hold.twists(actions), self.loss)
        return loss, self.hold.back(*bars)

    def converged(self, losses: list[float], best: np.ndarray, seed: int) -> bool:
        """The paper's rule (Algorithm 2): the loss has settled, and what it leads to is a success."""
        if not settled(losses) or len(losses) % PATIENCE > 0:
            return False
        return bool(played(self.env, best, seed)["is_success"])

    def check(self, actions: np.ndarray) -> np.ndarray:
        """What vouches for the gradient: derivative and central difference along the gradient and along random
        directions (1 + DIRECTIONS, 2), away from the bounds."""
        inner = 0.99 * actions
        _, gradient = self.value_and_grad(inner)
        rng = np.random.default_rng(0)
        ways = [gradient, *(rng.standard_normal(gradient.shape) for _ in range(DIRECTIONS))]
        rows = []
        for way in ways:
            unit = way / np.abs(way).max() if np.abs(way).max() > 0 else way
            ends = [self.rollout.value(*self.hold.twists(inner + s * unit), self.loss)
                    for s in (DIFFERENCE, -DIFFERENCE)]
            rows.append((float(np.sum(gradient * unit)), (ends[0] - ends[1]) / (2.0 * DIFFERENCE)))
        return np.array(rows)


def settled(losses: list[float]) -> bool:
    """Whether the loss has changed by less than CHANGE in each of more than PATIENCE iterations."""
    recent = np.array(losses[-PATIENCE - 2 :])
    return len(recent) > PATIENCE + 1 and bool(np.all(np.abs(np.diff(recent)) < CHANGE * np.abs(recent[:-1])))
