"""`robosim train`: learn a sub-task, with or without demonstrations."""

import os
from pathlib import Path
from typing import Any

import pydantic

import mpm
from policies.learning.installed import check_installed
from policies.learning.presets import Change, Preset, load_preset


def train(method: str, task: str, out: Path, *, seed: int = 0, demos: Path | None = None, episodes: int | None = None,
          material: str | None = None, starts: str = "nominal", hold: int = 10, obs: str | None = None,
          force: bool = False, frames: Path | None = None, change: Change | None = None) -> int:
    """Train a method in a folder to its end; returns 0. A finished run is not repeated.

    change: of the method's table, before it is checked.
    """
    check_installed()
    preset = load_preset(method, change)
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
