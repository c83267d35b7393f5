"""`robosim gradients`: how derivatives grow backwards in time, through fluid or clay, and through grains (the figure of
arXiv 2406.09178), and how far back they mean anything."""

import sys
from concurrent.futures import ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)
import numpy as np  # noqa: E402
from tqdm import tqdm  # noqa: E402

import mpm  # noqa: E402
from policies.demonstrations.action_repeat import Hold  # noqa: E402
from policies.demonstrations.generator import FLUID, STAND_INS, fingerprint, stored_in  # noqa: E402
from policies.demonstrations.workers import pool  # noqa: E402
from policies.learning.environments import made  # noqa: E402
from policies.learning.files import claim, write, write_json  # noqa: E402

TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")
"""Of the figure."""
HOLD = 10
"""Steps of 2 ms that an action is held."""
VARIANTS: dict[str, dict[str, Any]] = {
    "fluid or clay": {}, "grains": {}, "grains, SVD": {"svd": True}, "grains, smooth yield": {"soft": 0.1}}
"""Options of the roll-out."""
BACK = (10, 30, 100, 300, 1000)
"""Steps before the end in which the motion is changed, to compare its derivative with differences."""
DIFFERENCE, LATE = 1e-3, 100
"""Step in actions of -1 to 1; larger where a change comes so many steps before the end or later: it does little, which
in single precision drowns in the rounding of the loss."""
SLOWER, ASIDE = 0.98, 0.003
"""The motion: so much of the script's actions, and a random part of at most so much in each. The script carries its
tool level, with the nodes of the field's grid on those of the tool's distances: the least step to a side turns every
normal there, and differences see a jump that derivatives do not."""


def gradients(tasks: list[str], out: Path, jobs: int = 1) -> int:
    """Roll every task's script out and back in all variants; returns 0."""
    for task in tasks:
        if task not in TASKS:
            raise mpm.InvalidValue(f"unknown task {task!r}; valid: {', '.join(TASKS)}")
    if jobs < 1:
        raise mpm.InvalidValue(f"--jobs {jobs}; accepted: 1 or more")
    lock = claim(out)
    try:
        found = _all_rolled_back(tasks, out, jobs)
    finally:
        lock.release()
    write_json(out / "gradients.json", [row(*key, values) for key, values in found.items()])
    draw(out, tasks, found)
    for told in (row(*key, values) for key, values in found.items()):
        print(f"{told['task']:15s} {told['variant']:21s} growth {told['growth'] or float('nan'):9.2e}  "
              f"lost before step {told['lost_before']}  derivative, difference: "
              + "  ".join(f"{c['steps_before_the_end']}: {c['derivative']:.3g}, {c['difference']}"
                          for c in told["checks"]))
    return 0


def _all_rolled_back(tasks: list[str], out: Path, jobs: int) -> dict[tuple[str, str], dict[str, np.ndarray]]:
    """What every task's roll-out in every variant came to."""
    wanted = [(task, variant) for task in tasks for variant in VARIANTS]
    with ThreadPoolExecutor(jobs) as threads:
        started = [threads.submit(_apart, out, *both) for both in wanted]
        try:
            for ended in tqdm(as_completed(started), total=len(wanted), unit="roll-out", file=sys.stderr):
                ended.result()
        finally:
            threads.shutdown(cancel_futures=True)
    return {both: ended.result() for both, ended in zip(wanted, started)}


def place(task: str, variant: str, out: Path) -> Path:
    """File of a roll-out."""
    return out / f"{task}_{variant.replace(', ', '_').replace(' ', '_')}.npz"


def _apart(out: Path, task: str, variant: str) -> dict[str, np.ndarray]:
    """One roll-out, in a process of its own: it lays fields out that stay."""
    with pool(1) as process:
        try:
            return process.submit(_rolled_back, out, task, variant).result()
        except BrokenProcessPool as error:
            raise mpm.InvalidValue(f"{task} in {variant}: its process was killed; the same command goes on") from error


def _rolled_back(out: Path, task: str, variant: str) -> dict[str, np.ndarray]:
    """A roll-out and its derivatives, or what an earlier run has left of them."""
    own: Any = made(task).unwrapped
    material = STAND_INS.get(own.task.kind, FLUID) if variant == "fluid or clay" else own.task.material
    env: Any = made(task, material=material, action_repeat=HOLD).unwrapped
    mark = fingerprint(env, VARIANTS[variant], BACK, DIFFERENCE, SLOWER, ASIDE)
    stored = stored_in(place(task, variant, out), mark)
    if stored is not None:
        return stored
    env.reset(options={"nominal": True})
    rollout, hold, loss = env.rollout(**VARIANTS[variant]), Hold(env.task, HOLD), env.objective()
    script = hold.follow(env.task, env.task.steps * env.task.step_dt)
    actions = SLOWER * script + ASIDE * np.random.default_rng(0).uniform(-1.0, 1.0, script.shape)
    checks = np.zeros((0, 3))
    try:
        _, bars = rollout.value_and_grad(*hold.twists(actions), loss)
        norms, lost = rollout.last.norms, -1
        slopes = hold.back(*bars)
        checks = np.array([(back, *_compared(rollout, hold, loss, actions, slopes, back)) for back in BACK])
    except mpm.GradientDiverged as error:
        norms, lost = error.norms, error.step
    except mpm.SimulationDiverged:
        norms, lost = np.zeros((env.task.steps, 2)), env.task.steps
    found = {"norms": norms, "lost": np.array(lost), "checks": checks, "material": np.array(material),
             "fingerprint": np.array(mark)}
    write(place(task, variant, out), partial(np.savez, **found))
    return found


def _compared(rollout: Any, hold: Hold, loss: Any, actions: np.ndarray, slopes: np.ndarray,
              back: int) -> tuple[float, float]:
    """Derivative and central difference along a change of the ten steps that begin so many before the end; the
    difference is NaN where the changed motion diverges."""
    first = max(0, hold.n - back // hold.hold)
    way = np.zeros_like(actions)
    way[first] = np.random.default_rng(back).choice((-1.0, 1.0), actions.shape[1])
    step = DIFFERENCE * max(1.0, LATE / back)
    try:
        ends = [rollout.value(*hold.twists(actions + s * way), loss) for s in (step, -step)]
    except mpm.SimulationDiverged:
        ends = [np.nan, np.nan]
    return float(np.sum(slopes * way)), (ends[0] - ends[1]) / (2.0 * step)


def row(task: str, variant: str, values: dict[str, np.ndarray]) -> dict[str, Any]:
    """A roll-out's figures. growth: of the derivatives by positions, the largest over the last step's."""
    norms, lost = values["norms"][:, 0], int(values["lost"])
    last = norms[-1]
    return {"task": task, "variant": variant, "material": str(values["material"]),
            "growth": float(norms.max() / last) if last > 0 else None, "lost_before": lost if lost >= 0 else None,
            "checks": [{"steps_before_the_end": int(back), "derivative": float(slope),
                        "difference": float(difference) if np.isfinite(difference) else None}
                       for back, slope, difference in values["checks"]]}


def draw(out: Path, tasks: list[str], found: dict[tuple[str, str], dict[str, np.ndarray]]) -> None:
    """gradients.png: norms over reversed steps, a panel a task."""
    columns = min(4, len(tasks))
    figure, axes = plt.subplots(-(-len(tasks) // columns), columns, squeeze=False, sharey=True,
                                figsize=(4.2 * columns, 3.4 * -(-len(tasks) // columns)), constrained_layout=True)
    for k, task in enumerate(tasks):
        panel = axes.flat[k]
        for variant in VARIANTS:
            norms = found[task, variant]["norms"][::-1, 0]
            reached = np.flatnonzero(norms > 0)
            panel.semilogy(reached, norms[reached], lw=0.9, label=variant)
        panel.set(title=task, xlabel="reversed step")
    axes[0, 0].set_ylabel("|d loss / d positions| [1/m]")
    axes[0, 0].legend(fontsize=7)
    for panel in axes.flat[len(tasks):]:
        panel.set_visible(False)
    write(out / "gradients.png", lambda path: figure.savefig(path, dpi=120))
    plt.close(figure)
