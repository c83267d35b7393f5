"""`robosim train`: learn a sub-task, with or without demonstrations."""

import argparse
import os
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pydantic

import mpm
from policies.learning.presets import Preset, load_preset, methods

EXAMPLE = """examples:
  robosim train dg_sac SpoonPour --demos out/demo/SpoonPour --seed 0 --out out/runs/SpoonPour/dg_sac/seed_0
  robosim evaluate SpoonPour --policy out/runs/SpoonPour/dg_sac/seed_0/best.npz --nominal --out out/pour"""
NEEDED = ("torch", "stable_baselines3", "sb3_contrib", "tensorboard", "cma")


def command(commands: argparse._SubParsersAction) -> None:
    """Add `train` to the command line."""
    run = commands.add_parser("train", help="learn a sub-task", epilog=EXAMPLE,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("method", help=f"one of: {', '.join(methods())}; or a .yaml file of your own")
    run.add_argument("task", help="a sub-task, such as SpoonPour; a task's .yaml file; or an id of Gymnasium, such as "
                     "Pendulum-v1")
    run.add_argument("--out", type=Path, required=True, help="folder of the run; one that was cut short goes on")
    run.add_argument("--seed", type=int, default=0, help="of everything random (default: 0)")
    run.add_argument("--demos", type=Path, help="folder with demonstration_*.npz, or one .npz file with `actions`")
    run.add_argument("--frames", type=Path, help="folder of `robosim frames`, for methods with a network that foresees")
    run.add_argument("--episodes", type=int, help="at most (default: the method's)")
    run.add_argument("--material", help="of the grains (default: the task's)")
    run.add_argument("--starts", choices=["nominal", "random"], default="nominal",
                     help="where episodes start: the task's own place, or within its ranges (default: nominal)")
    run.add_argument("--action-repeat", type=int, default=10, help="steps of 2 ms that an action is held (default: 10)")
    run.add_argument("--obs", help="layout of the observation (default: the method's)")
    run.add_argument("--force", action="store_true", help="go on with a run of another configuration or commit")
    run.set_defaults(run=lambda a: train(
        a.method, a.task, a.out, seed=a.seed, demos=a.demos, episodes=a.episodes, material=a.material, starts=a.starts,
        hold=a.action_repeat, obs=a.obs, force=a.force, frames=a.frames))


def check_installed() -> None:
    """Raise mpm.InvalidValue where what learning needs is not installed."""
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise mpm.InvalidValue(f"learning needs {', '.join(missing)}: pip install '.[learn]' in the checkout")


def train(method: str, task: str, out: Path, *, seed: int = 0, demos: Path | None = None, episodes: int | None = None,
          material: str | None = None, starts: str = "nominal", hold: int = 10, obs: str | None = None,
          force: bool = False, frames: Path | None = None) -> int:
    """Run a method in a folder to its end; returns 0. A finished run is left alone."""
    check_installed()
    preset = load_preset(method)
    for name, number in (("--episodes", episodes), ("--action-repeat", hold)):
        if number is not None and number < 1:
            raise mpm.InvalidValue(f"{name} {number}; accepted: 1 or more")
    if seed < 0:
        raise mpm.InvalidValue(f"--seed {seed}; accepted: 0 or more")
    given = {key: value for key, value in (("episodes", episodes), ("obs", obs)) if value is not None}
    try:
        preset = Preset(**{**preset.model_dump(), **given})
    except pydantic.ValidationError as error:
        raise mpm.InvalidValue(f"method {method} with {given}: {error.errors()[0]['msg']}") from error
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import torch  # without learning nothing of it is loaded

    from policies.methods.adversarial import imitate
    from policies.methods.cloning import clone
    from policies.methods.evolution import evolve, replay
    from policies.methods.graph_search import foresee
    from policies.runs.training import Training

    torch.set_num_threads(1)
    options: dict[str, Any] = {"material": material} if material else {}
    training = Training(method, preset, task, out, seed=seed, demos=demos, starts=starts, hold=hold, force=force,
                        roll_outs=frames, **options)
    try:
        if training.folder.finished and not force:
            print(f"{out}: finished already")
            return 0
        training.folder.status("running")
        own = {"BC": clone, "GAIL": imitate, "CMA-ES": evolve, "GNN-CMA-ES": foresee, "replay": replay}
        own.get(preset.learner, Training.learn)(training)
    except KeyboardInterrupt:
        training.folder.status("stopped", reason="Ctrl-C; the same command goes on from the last checkpoint")
        raise
    except Exception as error:
        training.folder.status("failed", reason=f"{type(error).__name__}: {error}")
        raise
    else:
        training.finish()
    finally:
        training.folder.close()
    found = training.folder.read("status.json")
    print(f"{method} on {task}: best return {found['best_return']}, replayed {found['replayed']}")
    if training.cap is not None:  # of our own sub-tasks
        seen = [f"robosim evaluate {training.source} --policy {out / 'best.npz'} --episodes 1"]
        seen += ["--nominal"] if starts == "nominal" else []
        seen += [f"--material {material}"] if material else []
        print("to see it:", *seen, "--out FOLDER")
    return 0
