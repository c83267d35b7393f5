"""`robosim demo`: demonstrations by gradient descent through the field (arXiv 2406.09178, Algorithm 2)."""

import argparse
import hashlib
import json
import sys
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

from policies.descent import Descent
from policies.files import write, write_json
from policies.hold import Hold
from policies.learning_curve import draw

STAND_INS = {"move": "clay"}
"""Material that a kind of sub-task is learnt in, where it is not the fluid below."""
FLUID = "glycerol"
"""Water splashes: derivatives by its positions grow by five orders of magnitude over a pour, glycerol's by two."""
RATE = 0.05
"""Step in actions of -1 to 1."""
CHANGE, PATIENCE = 0.05, 5
"""A loss has settled when it has changed by less than this share for more than so many iterations."""
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
    run.add_argument("--from", dest="start", type=Path, help=".npz file with actions to begin with (default: none)")
    run.add_argument("--limit", type=float, help="cut entries of the state's derivatives in every substep, as sand's "
                     "may need (default: never)")
    run.add_argument("--seed", type=int, default=0, help="of the first start; the start of seed 0 is the task's own")
    run.set_defaults(run=lambda a: demonstrate(
        a.task, a.out, n=a.n, material=a.material, iterations=a.iterations, rate=a.rate, hold=a.hold, start=a.start,
        limit=a.limit, seed=a.seed))


def demonstrate(task: str, out: Path, *, n: int = 10, material: str | None = None, iterations: int = 150,
                rate: float = RATE, hold: int = 10, start: Path | None = None, limit: float | None = None,
                seed: int = 0) -> int:
    """Make demonstrations 0 .. n - 1 into a folder, with their table and curves; returns 0."""
    out.mkdir(parents=True, exist_ok=True)
    sand = gymnasium.make(f"robosim:robosim/{task}-v0", action_repeat=hold)
    view: Any = sand.unwrapped
    grains = view.task.material
    stand_in = material or STAND_INS.get(view.task.kind, FLUID)
    soft: Any = gymnasium.make(f"robosim:robosim/{task}-v0", material=stand_in, action_repeat=hold).unwrapped
    maker = Maker(soft, stand_in, hold, limit)
    first = actions_of(start, maker.hold) if start else np.zeros((maker.hold.n, maker.hold.dimensions))
    rows = []
    for k in range(n):
        path = out / f"demonstration_{k}.npz"
        found = finished(path, maker.fingerprint)
        if found is None:
            found = maker.run(path, seed + k, first, iterations, rate)
        in_sand = played(view, found["actions"], seed + k)
        in_soft = played(soft, found["actions"], seed + k)
        rows.append({"demonstration": path.name, "seed": seed + k, "loss": float(found["losses"].min()),
                     "iterations": len(found["losses"]), stand_in: in_soft, grains: in_sand})
        write_json(out / "demonstrations.json", {"task": task, "material": stand_in, "fingerprint": maker.fingerprint,
                                                 "demonstrations": rows})
        print(f"{path.name}: loss {rows[-1]['loss']:.3g}, in {stand_in} delivered {in_soft['delivered']:.2f}, in "
              f"{grains} delivered {in_sand['delivered']:.2f}, score {in_sand['tcs']:.2f}")
    draw(out, task, n)
    print(f"to see one: robosim evaluate {task} --policy {out / 'demonstration_0.npz'} --episodes 1 --out FOLDER")
    return 0


def fingerprint(env: Any, hold: int) -> str:
    """Twelve letters that change with the scene, the task or the material."""
    told = json.dumps([env.task.model_dump(), env.material.model_dump(), hold], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()[:12]


def actions_of(path: Path, hold: Hold) -> np.ndarray:
    """Actions to begin with, from a file; raises ValueError for another shape."""
    with np.load(path, allow_pickle=False) as stored:
        actions = np.asarray(stored["actions"], float)
    if actions.shape != (hold.n, hold.dimensions):
        raise ValueError(f"{path}: actions have shape {actions.shape}; accepted: {(hold.n, hold.dimensions)}")
    return actions


def finished(path: Path, expected: str) -> dict[str, np.ndarray] | None:
    """A demonstration that was made before, or None; raises ValueError for one of another scene."""
    if not path.is_file():
        return None
    with np.load(path, allow_pickle=False) as stored:
        found = dict(stored)
    if str(found["fingerprint"]) != expected:
        raise ValueError(f"{path}: made for another scene, task or material (fingerprint {found['fingerprint']}, now "
                         f"{expected}); give another --out, or remove it")
    return found


def played(env: Any, actions: np.ndarray, seed: int) -> dict[str, float]:
    """Score and readings of an episode with these actions."""
    env.reset(seed=seed, options={"nominal": seed == 0})
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
        self.fingerprint = fingerprint(env, hold)
        env.reset(seed=0, options={"nominal": True})
        self.rollout, self.loss = env.rollout(limit=limit), env.objective()

    def run(self, path: Path, seed: int, first: np.ndarray, iterations: int, rate: float) -> dict[str, np.ndarray]:
        """One demonstration from the start of a seed; goes on from the file beside `path` if there is one."""
        self.env.reset(seed=seed, options={"nominal": seed == 0})
        self.rollout.restart()
        self.hold.begin(self.env.solver.collider_pose(0).position)
        descent, losses, norms = Descent(first, rate), [], np.zeros((0, 2))
        beside = path.with_name(f"{path.stem}.unfinished.npz")
        stored = finished(beside, self.fingerprint)
        if stored is not None:
            descent.load(stored)
            losses, norms = list(stored["losses"]), stored["norms"]
        progress = tqdm(initial=len(losses), total=iterations, desc=path.stem, file=sys.stderr)
        while len(losses) < iterations and not self.converged(losses, descent.best, seed):
            loss, gradient = self.value_and_grad(descent.now)
            if loss < descent.lowest:
                norms = self.rollout.last.norms
            losses.append(loss)
            descent.step(loss, gradient)
            progress.set_postfix(loss=f"{loss:.3f}", best=f"{descent.lowest:.3f}")
            progress.update()
            kept = {"losses": np.array(losses), "norms": norms, "fingerprint": np.array(self.fingerprint)}
            write(beside, partial(np.savez, **kept, **descent.state()))
        progress.close()
        found = {"actions": descent.best.astype(np.float32), "losses": np.array(losses), "norms": norms,
                 "check": self.check(descent.best), "fingerprint": np.array(self.fingerprint), "seed": np.array(seed),
                 "material": np.array(self.material)}
        write(path, partial(np.savez, **found))
        beside.unlink(missing_ok=True)
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
