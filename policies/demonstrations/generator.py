"""What demonstrations are to be made, their files, and their generator: a search for each, stored after every step."""

import sys
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import mpm
from mpm.array_files import StoredArrays, read_arrays
from mpm.files import write
from policies.demonstrations.descent import Descent
from policies.demonstrations.motion_loss import MotionLoss
from policies.demonstrations.spline_search import SplineSearch
from policies.learning.environments import fingerprint, make_environment, score_motion
from policies.learning.options import SearchOptions
from robosim.base.progress import Progress

CLAY = "clay"
"""Material of the search where the tool is empty at the start. A fluid's surface lies below the rim of a level spoon
that stands on the container's floor, so that there is nothing to scoop."""
FLUID = "glycerol"
"""Not water, which splashes, nor glycerol at 40 C, which is a fifth as viscous as at 20 C: over the pour of a spoon its
derivatives by positions grow 200 times as much."""


def surrogate_material(task: Any) -> str:
    """Return the material that demonstrations of a task are searched in."""
    return FLUID if task.carried else CLAY


class DemonstrationRequest(NamedTuple):
    """The settings that all demonstrations of a folder share."""

    task: str
    """Name of a sub-task, or a task's .yaml file."""
    out: Path
    material: str
    """Material of the search."""
    first_actions: np.ndarray
    """(decisions, dimensions), where the search begins."""
    fixed: int
    """Number of first actions that the search does not change."""
    options: SearchOptions

    @property
    def name(self) -> str:
        """The task's name in files."""
        return Path(self.task).stem

    def path(self, k: int) -> Path:
        """Return the file of demonstration k."""
        return self.out / f"demonstration_{k}.npz"

    def unfinished_path(self, k: int) -> Path:
        """Return the file of demonstration k while its search runs."""
        return self.out / f"demonstration_{k}.unfinished.npz"

    def reset_arguments(self, k: int) -> dict[str, Any]:
        """Return the arguments of the environment's reset for demonstration k."""
        return {"seed": self.options.seed + k, "options": {"nominal": self.options.nominal and k == 0}}

    def fingerprint(self, k: int, env: Any) -> str:
        """Return a digest of all that demonstration k depends on."""
        o = self.options
        return fingerprint(env, self.material, o.action_repeat, o.limit, self.reset_arguments(k), o.rate,
                           self.first_actions.tolist(), self.fixed, o.method, o.arm_weight)

    def make_environment(self, **options: Any) -> Any:
        """Make the task's environment with the demonstrations' action_repeat."""
        return make_environment(self.task, action_repeat=self.options.action_repeat, **options).unwrapped


def load_stored(path: Path, expected: str) -> StoredArrays | None:
    """Return the arrays that an earlier call stored with the fingerprint `expected`, or None without a file.
    Raises mpm.InvalidValue for a file that cannot be read, has another fingerprint, or lacks the losses."""
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path)
    except ValueError as error:
        raise mpm.InvalidValue(f"{error}; give another --out, or remove it") from None
    if arrays.text("fingerprint", "none") != expected:
        raise mpm.InvalidValue(f"{path}: made for another scene, task, material, method, seed or start (fingerprint "
                               f"{arrays.text('fingerprint', 'none')}, now {expected}); give another --out, or remove "
                               f"it")
    if "losses" not in arrays:
        raise mpm.InvalidValue(f"{path}: has no array 'losses'; give another --out, or remove it")
    losses, norms = arrays["losses"], arrays.get("norms", np.zeros((0, 2)))
    if losses.ndim != 1 or losses.dtype.kind not in "iuf" or norms.shape[1:] != (2,) or norms.dtype.kind not in "iuf":
        raise mpm.InvalidValue(f"{path}: losses have shape {losses.shape}, norms {norms.shape}; accepted: numbers of "
                               f"shapes (n,) and (n, 2); remove it")
    return arrays


CHANGE, PATIENCE = 0.05, 5
"""A loss has settled when it has changed by less than this fraction in more than so many iterations."""


Search = Descent | SplineSearch
"""A search for the actions of least loss, one motion at a time: `now` is evaluated next."""


class DemonstrationGenerator:
    """Makes the demonstrations of a request, in one environment."""

    def __init__(self, request: DemonstrationRequest) -> None:
        self.request, self.options = request, request.options
        self.env = request.make_environment(material=request.material)
        self.loss = MotionLoss(self.env, self.options.action_repeat, limit=self.options.limit,
                               arm_weight=self.options.arm_weight)

    def make(self, k: int) -> dict[str, np.ndarray]:
        """Return the arrays of demonstration k: read if it is stored, else made, from a stored search if there is one.
        Raises mpm.InvalidValue where the folder holds another demonstration k, or every motion diverged."""
        r, iterations = self.request, self.options.iterations
        mark = r.fingerprint(k, self.env)
        arrays = load_stored(r.path(k), mark)
        if arrays is None:
            arrays = self._run(k, mark)
        elif len(arrays["losses"]) < iterations and not arrays.get("settled", has_settled(list(arrays["losses"]))):
            print(f"{r.path(k)}: has {len(arrays['losses'])} iterations and is not continued; remove it for "
                  f"{iterations}", file=sys.stderr)
        r.unfinished_path(k).unlink(missing_ok=True)
        return arrays

    def _run(self, k: int, mark: str) -> dict[str, np.ndarray]:
        """Search until the loss has converged; store the demonstration."""
        r, o, start = self.request, self.options, self.request.reset_arguments(k)
        self.env.reset(**start)
        self.loss.set_start()
        search = Descent(r.first_actions, o.rate, r.fixed) if o.method == "descent" else \
            SplineSearch(r.first_actions, start["seed"], r.fixed)
        losses, norms = [], np.zeros((0, 2))
        stored = load_stored(r.unfinished_path(k), mark)
        if stored is not None:
            try:
                search.load(stored)
            except ValueError as error:
                raise mpm.InvalidValue(f"{r.unfinished_path(k)}: {error}; remove it to begin anew") from None
            losses, norms = list(stored["losses"]), stored["norms"]
        progress = Progress(initial=len(losses), total=o.iterations, desc=r.path(k).stem, unit="iterations")

        def has_converged() -> bool:
            """Whether the loss has settled at a motion that succeeds (arXiv 2406.09178, Algorithm 2)."""
            return len(losses) % search.check_every == 0 and has_settled(search.convergence_losses(losses)) and \
                bool(score_motion(self.env, search.best, **start)["is_success"])

        while len(losses) < o.iterations and not has_converged():
            loss, norms = self._iterate(search, norms)
            losses.append(loss)
            progress.set_postfix(loss=f"{loss:.3f}", best=f"{search.lowest:.3f}")
            progress.update()
            write(r.unfinished_path(k), partial(np.savez, **{
                **search.state(), "losses": np.array(losses), "norms": norms, "fingerprint": np.array(mark)}))
        progress.close()
        if not np.isfinite(search.lowest):
            raise mpm.InvalidValue(f"{r.path(k).name}: every one of {len(losses)} motions diverged; begin with another "
                                   f"(--from), or take another --material")
        arrays = {"actions": search.best.astype(np.float32), "losses": np.array(losses), "norms": norms,
                  "check": self.loss.check_gradient(search.best) if search.uses_gradient else np.zeros((0, 2)),
                  "fingerprint": np.array(mark), "task": np.array(r.name), "seed": np.array(start["seed"]),
                  "nominal": np.array(start["options"]["nominal"]), "material": np.array(r.material),
                  "action_repeat": np.array(o.action_repeat), "method": np.array(o.method),
                  "settled": np.array(has_settled(search.convergence_losses(losses)))}
        write(r.path(k), partial(np.savez, **arrays))
        return arrays

    def _iterate(self, search: Search, norms: np.ndarray) -> tuple[float, np.ndarray]:
        """Evaluate the search's motion and step; return its loss and the norms of the best motion's derivatives."""
        try:
            if search.uses_gradient:
                loss, gradient = self.loss.value_and_grad(search.now)
                if loss < search.lowest:
                    norms = self.loss.rollout.last.norms
                search.step(loss, gradient)
            else:
                loss = self.loss.value(search.now)
                search.step(loss)
        except (mpm.SimulationDiverged, mpm.GradientDiverged):
            if search.uses_gradient and not np.isfinite(search.lowest):  # there is no motion to return to
                raise
            loss = np.inf
            search.fail()
        return loss, norms


def has_settled(losses: list[float]) -> bool:
    """Return whether the loss has changed by less than CHANGE in each of more than PATIENCE iterations."""
    recent = np.array(losses[-PATIENCE - 2 :])
    if len(recent) < PATIENCE + 2 or not np.isfinite(recent).all():
        return False
    return bool(np.all(np.abs(np.diff(recent)) < CHANGE * np.abs(recent[:-1])))


def make_demonstrations(request: DemonstrationRequest, indices: range) -> None:
    """Make some of the demonstrations of a request, in a worker process."""
    generator = DemonstrationGenerator(request)
    for k in indices:
        generator.make(k)
