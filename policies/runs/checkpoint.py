"""Checkpoints: a run that continues from one ends with the same bits as one that was never interrupted.
They hold pickles, as Stable-Baselines3's own files do, and a pickle executes code: one that is not signed with this
user's key is refused. Files to share are written by `policies.learners.policy_file`."""

import contextlib
import hmac
import io
import os
import pickle
import random
import secrets
import tempfile
import zipfile
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import torch

import mpm
from mpm.array_files import BROKEN
from mpm.files import write

SIGNATURE = 64
"""Characters of a signature, which is the comment of the archive, at its end."""
MAX_CHECKPOINT = 16 * 2**30
"""Bytes of a checkpoint: a replay buffer of 1 million observations of 1700 numbers, twice."""


def pack(model: Any, **parts: Any) -> bytes:
    """Return the file of a model (or None) with its replay buffer, all random numbers' states, and other parts."""
    if model is not None:
        parts["actions"] = model.action_space.np_random.bit_generator.state
    state = {"python": random.getstate(), "numpy": np.random.get_state(),  # noqa: NPY002  (SB3 draws from it)
             "torch": torch.get_rng_state(), **parts}
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.comment = b"0" * SIGNATURE
        if model is not None:
            stored_model = io.BytesIO()
            model.save(stored_model)
            archive.writestr("model.zip", stored_model.getvalue())
            if getattr(model, "replay_buffer", None) is not None:
                archive.writestr("buffer.pickle", pickle.dumps(model.replay_buffer, pickle.HIGHEST_PROTOCOL))
        archive.writestr("state.pickle", pickle.dumps(state, pickle.HIGHEST_PROTOCOL))
    content = packed.getbuffer()[:-SIGNATURE]
    return b"".join((content, sign(content)))


def sign(content: Any) -> bytes:
    """Return a signature with the key of this user, or with a passing one where no file can be kept."""
    path, key = Path(platformdirs.user_data_dir("robosim")) / "checkpoint.key", secrets.token_bytes(32)
    with contextlib.suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file():
            with tempfile.NamedTemporaryFile(buffering=0, dir=path.parent) as new, contextlib.suppress(FileExistsError):
                new.write(key)
                os.fsync(new)
                os.link(new.name, path)  # where another process was first, its key holds
        key = path.read_bytes()
    return hmac.digest(key, content, "sha256").hex().encode()


def load(path: Path, kind: Any = None, env: Any = None, is_trusted: bool = False) -> tuple[Any, dict[str, Any]]:
    """Return the model, of class `kind` (None: no model was stored), in an environment, and the other parts.
    Random numbers continue only once `restore_random_state` is called with the parts. Raises mpm.InvalidValue for a
    file that is damaged, too large, of other versions of its packages, or, unless it is trusted, of others."""
    try:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as mapped, memoryview(mapped) as view:
            if not (is_trusted or hmac.compare_digest(sign(view[:-SIGNATURE]), bytes(view[-SIGNATURE:]))):
                raise pickle.UnpicklingError("it was not written by this user's robosim here, and would execute code; "
                                             "--trust accepts it")
            with zipfile.ZipFile(file) as archive:  # of the file that was checked; first what its directory promises
                size, most = sum(member.file_size for member in archive.infolist()), min(MAX_CHECKPOINT, len(view))
                if size > most or any(member.compress_type != zipfile.ZIP_STORED for member in archive.infolist()):
                    raise ValueError(f"{size} bytes when unpacked; accepted: up to {most}, not compressed")
                parts = {member.filename: archive.read(member) for member in archive.infolist()}
        model = None
        if kind is not None:
            model = kind.load(io.BytesIO(parts["model.zip"]), env=env, device="cpu", force_reset=False)
            if "buffer.pickle" in parts:
                model.replay_buffer = pickle.loads(parts["buffer.pickle"])
        return model, pickle.loads(parts["state.pickle"])
    except (*BROKEN, pickle.UnpicklingError, AttributeError, ImportError, IndexError) as error:
        raise mpm.InvalidValue(f"{path}: cannot be read: {type(error).__name__}: {error}; remove it to begin the run "
                               f"anew") from error


def restore_random_state(state: dict[str, Any], model: Any = None) -> None:
    """Restore the states of all random numbers, also those of a model's first random actions."""
    if model is not None:
        model.action_space.np_random.bit_generator.state = state["actions"]
    random.setstate(state["python"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    torch.set_rng_state(state["torch"])


class Checkpoints:
    """The last checkpoint of a run, kept in memory until it is due, so that an interrupt loses an episode at most.
    every: episodes from one checkpoint on the disk to the next."""

    def __init__(self, path: Path, every: int) -> None:
        self._path, self._every, self.stored = path, every, 0
        self._kept: tuple[int, bytes] | None = None

    def keep(self, episodes: int, packed: bytes, at_once: bool) -> None:
        """Take a checkpoint after a number of episodes instead of the last one; write it if it is due, or at once."""
        self._kept = episodes, packed
        if at_once or episodes >= self.stored + self._every:
            self.write()

    def write(self) -> None:
        """Write the last checkpoint, unless it is written."""
        if self._kept is not None:
            episodes, packed = self._kept
            write(self._path, lambda temporary: temporary.write_bytes(packed))
            self._kept, self.stored = None, episodes

    def describe(self) -> str:
        """Return what the same command will do."""
        if not self._path.is_file():
            return "there is no checkpoint yet: the same command begins again"
        return f"the same command continues after {self.stored} episodes" if self.stored else \
            "the same command continues from the checkpoint"
