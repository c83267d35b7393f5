"""Makes one demonstration after the other in an environment: a search through the field, kept at every iteration."""

import hashlib
import json
import sys
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
from tqdm import tqdm

import mpm
from policies.demonstrations.action_repeat import Hold
from policies.demonstrations.descent import Descent
from policies.demonstrations.spline_search import Evolution
from policies.learning.environments import made
from policies.learning.files import write

STAND_INS = {"move": "clay", "scoop": "clay"}
"""Material that a kind of sub-task is learnt in, where it is not the fluid below: a fluid's surface lies below the rim
of a level spoon that stands on the container's floor, so that there is nothing to scoop."""
FLUID = "glycerol"
"""Water splashes: derivatives by its positions grow by four orders of magnitude over a pour, glycerol's by two."""
CHANGE, PATIENCE = 0.05, 5
"""A loss has settled when it has changed by less than this share for more than so many iterations."""
DIRECTIONS = 3
DIFFERENCE = 1e-3
"""Step in actions of the check by differences: in single precision a smaller one drowns in rounding."""


class Wanted(NamedTuple):
    """What demonstrations are to be made, apart from their starts."""

    task: str
    """What commands call it: a name or a file."""
    out: Path
    material: str
    """That the search goes through."""
    first: np.ndarray
    """Actions to begin with (decisions, dimensions)."""
    kept: int
    """How many of them stay as they are."""
    method: str
    iterations: int
    rate: float
    hold: int
    limit: float | None
    arm_weight: float
    """Of the penalty on what the arm cannot follow, 0: none."""
    seed: int
    """Of the first start."""
    nominal: bool
    """Whether the first start is the task's own instead."""

    @property
    def name(self) -> str:
        """What files call the task."""
        return Path(self.task).stem

    def path(self, k: int) -> Path:
        """File of a demonstration."""
        return self.out / f"demonstration_{k}.npz"

    def start(self, k: int) -> dict[str, Any]:
        """What the environment is reset with for a demonstration."""
        return {"seed": self.seed + k, "options": {"nominal": self.nominal and k == 0}}

    def environment(self, **options: Any) -> Any:
        """The sub-task, with decisions as long as the demonstrations'."""
        return made(self.task, action_repeat=self.hold, **options).unwrapped


def fingerprint(env: Any, *rest: object) -> str:
    """Twelve letters that change with the scene, the task, the material or anything else that is given."""
    told = json.dumps([env.task.model_dump(), env.material.model_dump(), *rest], sort_keys=True, default=str)
    return hashlib.sha256(told.encode()).hexdigest()[:12]


def stored_in(path: Path, expected: str) -> dict[str, np.ndarray] | None:
    """What an earlier run left, or None; raises InvalidValue where that was another run."""
    if not path.is_file():
        return None
    try:
        with np.load(path, allow_pickle=False) as stored:
            found = dict(stored)
    except (ValueError, EOFError, BadZipFile) as error:
        raise mpm.InvalidValue(f"{path}: cannot be read: {error}; give another --out, or remove it") from error
    if str(found.get("fingerprint")) != expected:
        raise mpm.InvalidValue(f"{path}: made for another scene, task, material, method, seed or start (fingerprint "
                               f"{found.get('fingerprint')}, now {expected}); give another --out, or remove it")
    return found


def played(env: Any, actions: np.ndarray, start: dict[str, Any]) -> dict[str, float]:
    """Score and readings of an episode with these actions."""
    env.reset(**start)
    info: dict[str, Any] = {}
    for action in np.asarray(actions, np.float32):
        _, _, terminated, truncated, info = env.step(action)
        if terminated or truncated:
            break
    return {"tcs": info["tcs"], "is_success": bool(info["is_success"]), **info["readings"]}


class Maker:
    """Makes demonstrations in one environment."""

    def __init__(self, wanted: Wanted) -> None:
        self.wanted, self.env = wanted, wanted.environment(material=wanted.material)
        self.hold = Hold(self.env.task, wanted.hold)
        self.loss = self.env.objective()

    @cached_property
    def rollout(self) -> Any:
        """Laid out when it is needed."""
        return self.env.rollout(limit=self.wanted.limit)

    @cached_property
    def reach(self) -> Any:
        """The arm, where its limits count."""
        return self.env.reach()

    def make(self, k: int) -> dict[str, np.ndarray]:
        """Demonstration k: read if it is there, gone on with if a run was cut short."""
        w = self.wanted
        mark = fingerprint(self.env, w.material, w.hold, w.limit, w.start(k), w.rate, w.first.tolist(), w.kept,
                           w.method, w.arm_weight)
        beside = w.path(k).with_name(f"demonstration_{k}.unfinished.npz")
        found = stored_in(w.path(k), mark)
        if found is None:
            found = self._run(k, beside, mark)
        elif len(found["losses"]) < w.iterations and not found.get("settled", settled(list(found["losses"]))):
            print(f"{w.path(k)}: kept as it is after {len(found['losses'])} iterations; remove it for {w.iterations}",
                  file=sys.stderr)
        beside.unlink(missing_ok=True)
        return found

    def _search(self, seed: int) -> Descent | Evolution:
        w = self.wanted
        return Descent(w.first, w.rate, w.kept) if w.method == "descent" else Evolution(w.first, seed, w.kept)

    def _run(self, k: int, beside: Path, mark: str) -> dict[str, np.ndarray]:
        w, start = self.wanted, self.wanted.start(k)
        self.env.reset(**start)
        self.rollout.restart()
        self.pose = self.env.solver.collider_pose(0)
        self.hold.begin(self.pose.position)
        search, losses, norms = self._search(start["seed"]), [], np.zeros((0, 2))
        stored = stored_in(beside, mark)
        if stored is not None:
            search.load(stored)
            losses, norms = list(stored["losses"]), stored["norms"]
        progress = tqdm(initial=len(losses), total=w.iterations, desc=w.path(k).stem, file=sys.stderr)
        while len(losses) < w.iterations and not self.converged(losses, search, start):
            try:
                if isinstance(search, Descent):
                    loss, gradient = self.value_and_grad(search.now)
                    if loss < search.lowest:
                        norms = self.rollout.last.norms
                    search.step(loss, gradient)
                else:
                    loss = self.value(search.now)
                    search.step(loss)
            except (mpm.SimulationDiverged, mpm.GradientDiverged):
                if isinstance(search, Descent) and not np.isfinite(search.lowest):  # no better motion to go back to
                    raise
                loss = np.inf
                search.fail()
            losses.append(loss)
            progress.set_postfix(loss=f"{loss:.3f}", best=f"{search.lowest:.3f}")
            progress.update()
            kept = {"losses": np.array(losses), "norms": norms, "fingerprint": np.array(mark)}
            write(beside, partial(np.savez, **kept, **search.state()))
        progress.close()
        if not np.isfinite(search.lowest):
            raise mpm.InvalidValue(f"{w.path(k).name}: every one of {len(losses)} motions diverged; begin with another "
                                   f"(--from), or take another --material")
        found = {"actions": search.best.astype(np.float32), "losses": np.array(losses), "norms": norms,
                 "check": self.check(search.best), "fingerprint": np.array(mark),
                 "task": np.array(w.name), "seed": np.array(start["seed"]),
                 "nominal": np.array(start["options"]["nominal"]), "material": np.array(w.material),
                 "hold": np.array(w.hold), "method": np.array(w.method),
                 "settled": np.array(settled(search.course(losses)))}
        write(w.path(k), partial(np.savez, **found))
        return found

    def value(self, actions: np.ndarray) -> float:
        """Loss of the actions."""
        twists = self.hold.twists(actions)
        loss = self.rollout.value(*twists, self.loss)
        if self.wanted.arm_weight:
            loss += self.wanted.arm_weight * self.reach.penalty(self.pose, *twists)[0]
        return loss

    def value_and_grad(self, actions: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss and its derivatives by the actions."""
        twists = self.hold.twists(actions)
        loss, bars = self.rollout.value_and_grad(*twists, self.loss)
        if self.wanted.arm_weight:
            more, more_bars = self.reach.penalty(self.pose, *twists)
            loss += self.wanted.arm_weight * more
            bars = tuple(a + self.wanted.arm_weight * b for a, b in zip(bars, more_bars))
        return loss, self.hold.back(*bars)

    def converged(self, losses: list[float], search: Descent | Evolution, start: dict[str, Any]) -> bool:
        """The paper's rule (Algorithm 2): the loss has settled, and what it leads to is a success."""
        every = PATIENCE if isinstance(search, Descent) else search.population
        if len(losses) % every > 0 or not settled(search.course(losses)):
            return False
        return bool(played(self.env, search.best, start)["is_success"])

    def check(self, actions: np.ndarray) -> np.ndarray:
        """What vouches for the gradient: derivative and central difference along the gradient and along random
        directions (1 + DIRECTIONS, 2), away from the bounds; nothing (0, 2) where no gradient was used, or where a
        motion so near to the best one diverges."""
        if self.wanted.method != "descent":
            return np.zeros((0, 2))
        try:
            return self._checked(0.99 * actions)
        except (mpm.SimulationDiverged, mpm.GradientDiverged) as error:
            print(f"the gradient of the best motion is not checked: {error}", file=sys.stderr)
            return np.zeros((0, 2))

    def _checked(self, inner: np.ndarray) -> np.ndarray:
        """Derivatives and differences (1 + DIRECTIONS, 2) at a motion."""
        _, gradient = self.value_and_grad(inner)
        rng = np.random.default_rng(0)
        ways = [gradient, *(rng.standard_normal(gradient.shape) for _ in range(DIRECTIONS))]
        rows = []
        for way in ways:
            unit = way / np.abs(way).max() if np.abs(way).max() > 0 else way
            ends = [self.value(inner + s * unit) for s in (DIFFERENCE, -DIFFERENCE)]
            rows.append((float(np.sum(gradient * unit)), (ends[0] - ends[1]) / (2.0 * DIFFERENCE)))
        return np.array(rows)


def settled(losses: list[float]) -> bool:
    """Whether the loss has changed by less than CHANGE in each of more than PATIENCE iterations."""
    recent = np.array(losses[-PATIENCE - 2 :])
    if len(recent) < PATIENCE + 2 or not np.isfinite(recent).all():
        return False
    return bool(np.all(np.abs(np.diff(recent)) < CHANGE * np.abs(recent[:-1])))


def make_some(wanted: Wanted, which: range) -> None:
    """Make some of the demonstrations, in a process of its own."""
    maker = Maker(wanted)
    for k in which:
        maker.make(k)
