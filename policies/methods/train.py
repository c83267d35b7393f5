"""`robosim train`: learn a sub-task, with or without demonstrations."""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pydantic

import mpm
from policies.learning.names import check_installed
from policies.learning.options import TrainingOptions, check_at_least
from policies.learning.presets import Preset, load_preset
from robosim.config.settings import Setting


def train(method: str, task: str, out: Path, options: TrainingOptions, *, episodes: int | None = None,
          obs: str | None = None, settings: Sequence[Setting] = (), page: Callable = lambda out: None) -> int:
    """Run a method in a folder to its end; return 0. A finished run is not repeated.
    episodes, obs: instead of the preset's. settings: in place of values of the method's file. page: writes a page of
    the finished run. Raises ConfigError for a wrong method or setting, mpm.InvalidValue for a missing package, or
    options that do not fit."""
    check_installed()
    check_at_least(1, {} if episodes is None else {"--episodes": episodes})
    given = {key: value for key, value in (("episodes", episodes), ("obs", obs)) if value is not None}
    try:
        preset = Preset(**{**load_preset(method, settings).model_dump(), **given})
    except pydantic.ValidationError as error:
        raise mpm.InvalidValue(f"method {method} with {given}: {error.errors()[0]['msg']}") from error
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    import torch  # heavy: only training loads it

    from policies.methods.method import select_method
    from policies.runs.training import Training

    torch.set_num_threads(1)
    training = Training(method, preset, task, out, options)
    try:
        if training.folder.is_finished and not options.force:
            print(f"{out}: finished already")
            return 0
        training.folder.update_status("running")
        select_method(preset.learner)(training)
        training.finish()
        page(out)
    except BaseException as error:
        print(f"{out}: {training.env.count} episodes finished; {training.stop(error)}", file=sys.stderr)
        try:
            page(out)
        except Exception as failure:  # the error that ended the run is the one to raise
            print(f"{out}: no page: {failure}", file=sys.stderr)
        raise
    finally:
        training.folder.close()
    status = training.folder.read_json("status.json")
    print(f"{method} on {task}: best return {status['best_return']}, replayed {status['replayed']}")
    if status.get("evaluated"):
        print(f"deterministic policy: best {status['evaluated']['best']}, last {status['evaluated']['last']}")
    if training.is_granular:
        arguments = [f"robosim evaluate {training.source} --policy {out / 'best.npz'} --episodes 1"]
        arguments += ["--nominal"] if training.reset_options else []
        arguments += [f"--material {options.material}"] if options.material else []
        print("to film it:", *arguments, "--out FOLDER")
    return 0
