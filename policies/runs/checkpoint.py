"""Checkpoints: a run that continues from one ends with the same bits as one that was never interrupted.

They hold pickles, as Stable-Baselines3's own files do, and a pickle executes code: load your own only. Files to share
are written by `policies.learners.policy_file`.
"""

import io
import pickle
import random
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import torch

from policies.learning.files import write


def save(path: Path, model: Any, **parts: Any) -> None:
    """Write a model (or None) with its replay buffer, the states of all random numbers, and other parts."""
    if model is not None:
        parts["actions"] = model.action_space.np_random.bit_generator.state
    state = {"python": random.getstate(), "numpy": np.random.get_state(),  # noqa: NPY002  (SB3 draws from it)
             "torch": torch.get_rng_state(), **parts}

    def write_archive(temporary: Path) -> None:
        with zipfile.ZipFile(temporary, "w") as archive:
            if model is not None:
                stored_model = io.BytesIO()
                model.save(stored_model)
                archive.writestr("model.zip", stored_model.getvalue())
                if getattr(model, "replay_buffer", None) is not None:
                    archive.writestr("buffer.pickle", pickle.dumps(model.replay_buffer, pickle.HIGHEST_PROTOCOL))
            archive.writestr("state.pickle", pickle.dumps(state, pickle.HIGHEST_PROTOCOL))

    write(path, write_archive)


def load(path: Path, kind: Any, env: Any) -> tuple[Any, dict[str, Any]]:
    """Return the model, of class `kind` (None: no model was stored), in an environment, and the other parts.

    Random numbers continue only once `restore_random_state` is called with the parts.
    """
    with zipfile.ZipFile(path) as archive:
        model = None
        if kind is not None:
            model = kind.load(io.BytesIO(archive.read("model.zip")), env=env, device="cpu", force_reset=False)
            if "buffer.pickle" in archive.namelist():
                model.replay_buffer = pickle.loads(archive.read("buffer.pickle"))
        return model, pickle.loads(archive.read("state.pickle"))


def restore_random_state(state: dict[str, Any], model: Any = None) -> None:
    """Restore the states of all random numbers, also those of a model's first random actions."""
    if model is not None:
        model.action_space.np_random.bit_generator.state = state["actions"]
    random.setstate(state["python"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(state["torch"])
