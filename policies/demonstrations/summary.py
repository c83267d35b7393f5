"""Summary of demonstrations: the table of their scores, and plots of losses and derivatives."""

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

from mpm.array_files import read_arrays
from mpm.files import write
from policies.demonstrations.generator import DemonstrationGenerator
from policies.demonstrations.request import DemonstrationRequest
from policies.learning.environments import score_motion
from robosim.base.files import write_json

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend must be chosen first)

NORM_LABEL = "|d loss / d positions| [1/m]"


def draw_learning_curves(out: Path, task: str, n: int) -> None:
    """Write learning_curve.png from demonstrations 0 to n - 1 of a folder."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 4.5), constrained_layout=True)
    for k in range(n):
        stored = read_arrays(out / f"demonstration_{k}.npz")
        left.plot(stored["losses"], label=f"{k}, seed {int(stored['seed'])}")
        norms = stored["norms"]
        right.semilogy(np.arange(len(norms)), np.maximum(norms[:, 0], 1e-30), lw=0.8)
    left.set(xlabel="iteration", ylabel="loss", title=task)
    left.legend(fontsize=7)
    right.set(xlabel="step of the rollout", ylabel=NORM_LABEL, title="derivatives before each step, best iterate")
    _save(figure, out / "learning_curve.png")


def draw_gradient_norms(path: Path, norms: dict[str, dict[str, np.ndarray]]) -> None:
    """Write norms (steps,) over reversed steps to a picture, a panel for each task and a line for each variant.
    norms: task -> variant -> norms."""
    columns = min(4, len(norms))
    rows = -(-len(norms) // columns)
    figure, axes = plt.subplots(rows, columns, squeeze=False, sharey=True, figsize=(4.2 * columns, 3.4 * rows),
                                constrained_layout=True)
    for panel, (task, variants) in zip(axes.flat, norms.items()):
        for variant, values in variants.items():
            reversed_norms = values[::-1]
            positive = np.flatnonzero(reversed_norms > 0)
            panel.semilogy(positive, reversed_norms[positive], lw=0.9, label=variant)
        panel.set(title=task, xlabel="reversed step")
    axes[0, 0].set_ylabel(NORM_LABEL)
    axes[0, 0].legend(fontsize=7)
    for panel in axes.flat[len(norms):]:
        panel.set_visible(False)
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    write(path, lambda temporary: figure.savefig(temporary, dpi=120))
    plt.close(figure)


def write_table(request: DemonstrationRequest, n: int, env: Any, *, arm: bool) -> None:
    """Write demonstrations.json for demonstrations 0 to n - 1, making those that are missing.
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
