"""Checkpoints between two episodes: a run that goes on from one ends with the same bits as one that was never stopped.

They hold pickles, as stable_baselines3's own files do: load those that you made. What is shipped is `network`'s.
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


def save(path: Path, model: Any, **more: Any) -> None:
    """Keep a model with its buffers, the states of all random numbers, and what else is given."""
    if model is not None:
        more["actions"] = model.action_space.np_random.bit_generator.state
    state = {"python": random.getstate(), "numpy": np.random.get_state(),  # noqa: NPY002  (what stable_baselines3 draws from)
             "torch": torch.get_rng_state(), **more}

    def parts(beside: Path) -> None:
        with zipfile.ZipFile(beside, "w") as file:
            if model is not None:
                inner = io.BytesIO()
                model.save(inner)
                file.writestr("model.zip", inner.getvalue())
                if getattr(model, "replay_buffer", None) is not None:
                    file.writestr("buffer.pickle", pickle.dumps(model.replay_buffer, pickle.HIGHEST_PROTOCOL))
            file.writestr("state.pickle", pickle.dumps(state, pickle.HIGHEST_PROTOCOL))

    write(path, parts)


def load(path: Path, kind: Any, env: Any) -> tuple[Any, dict[str, Any]]:
    """The model, of class `kind` (None: none was kept), in an environment, and what else was kept. The random numbers
    go on where they were, once `resume` is called with it."""
    with zipfile.ZipFile(path) as file:
        model = None
        if kind is not None:
            model = kind.load(io.BytesIO(file.read("model.zip")), env=env, device="cpu", force_reset=False)
            if "buffer.pickle" in file.namelist():
                model.replay_buffer = pickle.loads(file.read("buffer.pickle"))
        return model, pickle.loads(file.read("state.pickle"))


def resume(state: dict[str, Any], model: Any = None) -> None:
    """Let the random numbers go on where they were, those of a model's first random actions too."""
    if model is not None:
        model.action_space.np_random.bit_generator.state = state["actions"]
    random.setstate(state["python"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(state["torch"])
