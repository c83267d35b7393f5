"""`robosim gradients`: growth of derivatives backwards in time, through fluid, clay and grains, and their accuracy.
Source: the figure of arXiv 2406.09178."""

from pathlib import Path
from typing import Any

import numpy as np

import mpm
from policies.demonstrations import TASKS
from policies.demonstrations.generator import surrogate_material
from policies.demonstrations.motion_loss import DIFFERENCE, MotionLoss
from policies.learning.environments import make_environment
from policies.learning.options import check_at_least
from robosim.base.files import write_json, write_text
from robosim.base.output_folder import OutputFolder
from robosim.base.study import Job, Study
from robosim.reports.page import Page
from robosim.tasks.task import load_task

ACTION_REPEAT = 10
SURROGATE = "fluid or clay"
VARIANTS: dict[str, dict[str, Any]] = {
    SURROGATE: {}, "grains": {}, "grains, SVD": {"svd": True}, "grains, smooth yield": {"soft": 0.1}}
"""Options of the rollout in each variant; SURROGATE is the material of demonstrations, the others the task's own."""
STEPS_BEFORE_END = (10, 30, 100, 300, 1000)
"""Where the motion is changed to compare its derivative with finite differences."""
LATE = 100
"""A change so many steps before the end or later has little effect, which single precision's rounding of the loss would
hide: there the step of the difference is larger."""
SCRIPT_SCALE, PERTURBATION = 0.98, 0.003
"""The motion is SCRIPT_SCALE x the script's actions plus a uniform random part of up to PERTURBATION. The script alone
keeps its tool level, with the field's nodes on those of the tool's distances, where any sideways step changes every
normal: finite differences would show a jump that derivatives do not."""
Results = dict[tuple[str, str], dict[str, np.ndarray]]
"""Arrays of each (task, variant)."""


def gradients(tasks: list[str], out: Path, jobs: int = 1) -> int:
    """Differentiate the script of every task in all variants; write gradients.json and index.html; return 0.
    Raises mpm.InvalidValue for an unknown task, jobs below 1, or a process that failed."""
    for task in tasks:
        if Path(task).stem not in TASKS:
            raise mpm.InvalidValue(f"unknown task {task!r}; valid: {', '.join(TASKS)}")
    check_at_least(1, {"--jobs": jobs})
    keys = [(task, variant) for task in tasks for variant in VARIANTS]
    work = [Job("policies.demonstrations.gradients:differentiate", {"task": task, "variant": variant},
                depends=load_task(task).model_dump(mode="json", exclude={"description"})) for task, variant in keys]
    with OutputFolder(out):
        rows = Study(out, jobs).rows(work, "gradients", "rollouts")
        failed = [f"{task} in {variant}: {row.failed}" for (task, variant), row in zip(keys, rows) if row.failed]
        if failed:
            raise mpm.InvalidValue(f"{'; '.join(failed)}; what is finished is kept, the same command continues")
        write_results(out, tasks, {(Path(task).stem, variant): {name: np.array(one) for name, one in row.value.items()}
                                   for (task, variant), row in zip(keys, rows)})
    return 0


def write_results(out: Path, tasks: list[str], results: Results) -> None:
    """Write gradients.json and a page, and print the figures."""
    rows = [summarise(*key, arrays) for key, arrays in results.items()]
    write_json(out / "gradients.json", rows)
    charts: dict[str, dict[str, tuple[list[float], list[float]]]] = {Path(task).stem: {} for task in tasks}
    for (task, variant), arrays in results.items():
        norms = arrays["norms"][::-1, 0]
        positive = np.flatnonzero(norms > 0)
        charts[task][variant] = positive.tolist(), norms[positive].tolist()
    page = Page("Growth of derivatives backwards in time")
    page.add_curves({f"{task}: |d loss / d positions| [1/m]": curves for task, curves in charts.items()},
                    "reversed step", "A click in the legend hides a curve.", is_logarithmic=True)
    write_text(out / "index.html", page.html())
    for row in rows:
        print(f"{row['task']:15s} {row['variant']:21s} growth {row['growth'] or float('nan'):9.2e}  "
              f"lost before step {row['lost_before']}  derivative, difference: "
              + "  ".join(f"{c['steps_before_the_end']}: {c['derivative']:.3g}, {c['difference']}"
                          for c in row["checks"]))


def differentiate(task: str, variant: str) -> dict[str, Any]:
    """Return the derivatives of a rollout and their checks, for one process: Taichi keeps a rollout's fields."""
    own: Any = make_environment(task).unwrapped
    material = surrogate_material(own.task) if variant == SURROGATE else own.task.material
    env: Any = make_environment(task, material=material, action_repeat=ACTION_REPEAT).unwrapped
    env.reset(options={"nominal": True})
    loss = MotionLoss(env, ACTION_REPEAT, **VARIANTS[variant])
    script = loss.actions.follow_script(env.task, env.task.steps * env.task.step_dt)
    actions = SCRIPT_SCALE * script + PERTURBATION * np.random.default_rng(0).uniform(-1.0, 1.0, script.shape)
    checks = np.zeros((0, 3))
    try:
        _, gradient = loss.value_and_grad(actions)
        norms, lost = loss.rollout.last.norms, -1
        checks = np.array([(steps, *_compare_with_difference(loss, actions, gradient, steps))
                           for steps in STEPS_BEFORE_END])
    except mpm.GradientDiverged as error:
        norms, lost = error.norms, error.step
    except mpm.SimulationDiverged:
        norms, lost = np.zeros((env.task.steps, 2)), env.task.steps
    return {"norms": norms.tolist(), "lost": lost, "checks": checks.tolist(), "material": material}


def _compare_with_difference(loss: MotionLoss, actions: np.ndarray, gradient: np.ndarray,
                             steps_before_end: int) -> tuple[float, float]:
    """Return derivative and central difference along a random change of one action.
    The difference is NaN where a changed motion diverges."""
    direction = np.zeros_like(actions)
    decision = max(0, len(actions) - steps_before_end // ACTION_REPEAT)
    direction[decision] = np.random.default_rng(steps_before_end).choice((-1.0, 1.0), actions.shape[1])
    try:
        difference = loss.difference(actions, direction, DIFFERENCE * max(1.0, LATE / steps_before_end))
    except mpm.SimulationDiverged:
        difference = np.nan
    return float(np.sum(gradient * direction)), difference


def summarise(task: str, variant: str, arrays: dict[str, np.ndarray]) -> dict[str, Any]:
    """Return a row of gradients.json.
    growth: largest norm of the derivatives by positions divided by that before the last step. lost_before: step before
    which derivatives are no longer finite, or None."""
    norms, lost = arrays["norms"][:, 0], int(arrays["lost"])
    last = norms[-1]
    return {"task": task, "variant": variant, "material": str(arrays["material"]),
            "growth": float(norms.max() / last) if last > 0 else None, "lost_before": lost if lost >= 0 else None,
            "checks": [{"steps_before_the_end": int(steps), "derivative": float(derivative),
                        "difference": float(difference) if np.isfinite(difference) else None}
                       for steps, derivative, difference in arrays["checks"]]}
