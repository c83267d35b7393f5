"""`robosim train`: learn a sub-task, with or without demonstrations."""

import os
import sys
from pathlib import Path
from typing import Any

import pydantic

import mpm
from policies.learning.bundled import check_installed
from policies.learning.preset_files import Change, load_preset
from policies.learning.presets import Preset


def train(method: str, task: str, out: Path, *, seed: int = 0, demos: Path | None = None, episodes: int | None = None,
          material: str | None = None, starts: str = "nominal", action_repeat: int = 10, obs: str | None = None,
          force: bool = False, rollouts: Path | None = None, checkpoint_every: int = 10,
          evaluate_every: int = 10, label: str | None = None, n_envs: int = 1, change: Change | None = None) -> int:
    """Run a method in a folder to its end; return 0. A finished run is not repeated.

    episodes, obs: instead of the preset's. change: of the method's table, before it is checked. Other arguments as in
    `policies.runs.training.Training`.

    Raises:
        mpm.InvalidValue: a package is missing, or arguments do not fit.
    """
    check_installed()
    for name, number in (("--episodes", episodes), ("--action-repeat", action_repeat),
                         ("--checkpoint-every", checkpoint_every), ("--evaluate-every", evaluate_every),
                         ("--n-envs", n_envs)):
        if number is not None and number < 1:
            raise mpm.InvalidValue(f"{name} {number}; accepted: 1 or more")
    if seed < 0:
        raise mpm.InvalidValue(f"--seed {seed}; accepted: 0 or more")
    preset = prepare_preset(method, change, episodes=episodes, obs=obs)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import torch  # heavy: only training loads it

    from policies.methods.method import select_method
    from policies.runs.training import Training

    torch.set_num_threads(1)
    options: dict[str, Any] = {"material": material} if material else {}
    training = Training(method, preset, task, out, seed=seed, demos=demos, starts=starts, action_repeat=action_repeat,
                        force=force, rollouts=rollouts, checkpoint_every=checkpoint_every,
                        evaluate_every=evaluate_every, label=label, n_envs=n_envs, **options)
    try:
        if training.folder.is_finished and not force:
            print(f"{out}: finished already")
            return 0
        training.folder.update_status("running")
        select_method(preset.learner)(training)
        training.finish()
    except BaseException as error:
        print(f"{out}: {training.env.count} episodes finished; {training.stop(error)}", file=sys.stderr)
        raise
    finally:
        training.folder.close()
    status = training.folder.read_json("status.json")
    print(f"{method} on {task}: best return {status['best_return']}, replayed {status['replayed']}")
    if status.get("evaluated"):
        print(f"deterministic policy: best {status['evaluated']['best']}, last {status['evaluated']['last']}")
    if training.is_granular:
        arguments = [f"robosim evaluate {training.source} --policy {out / 'best.npz'} --episodes 1"]
        arguments += ["--nominal"] if starts == "nominal" else []
        arguments += [f"--material {material}"] if material else []
        print("to film it:", *arguments, "--out FOLDER")
    return 0


def prepare_preset(method: str, change: Change | None, **settings: Any) -> Preset:
    """Return a method's preset with settings that are not None instead of its own."""
    preset = load_preset(method, change)
    given = {key: value for key, value in settings.items() if value is not None}
    try:
        return Preset(**{**preset.model_dump(), **given})
    except pydantic.ValidationError as error:
        raise mpm.InvalidValue(f"method {method} with {given}: {error.errors()[0]['msg']}") from error
