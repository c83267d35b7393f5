"""The folder of a run: what it is (manifest.json), how far it got (status.json), its episodes (episodes.csv), its best
(best.npz) and its last checkpoint."""

import csv
import json
import os
import platform
import subprocess
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

import mpm
from policies.learning.files import claim, write, write_json
from policies.learning.presets import known
from policies.runs.episodes import Episode

IDENTITY = ("method", "preset", "task", "material", "seed", "starts", "hold", "fingerprint", "demonstrations", "commit")
"""Parts of a manifest that a run must share with what lies in its folder."""
LAST = 10
"""Episodes at the end that the paper's training reward is the mean of."""


def commit() -> str:
    """The commit of the code that runs, "-dirty" where it is not what was committed; its version outside a checkout."""
    here = Path(__file__).resolve().parents[1]
    try:
        told = subprocess.run(["git", "describe", "--always", "--dirty", "--exclude=*"], cwd=here, capture_output=True,
                              text=True, check=False) if (here.parent / ".git").exists() else None
    except OSError:  # a checkout without git
        told = None
    return told.stdout.strip() if told is not None and told.returncode == 0 else version("robosim")


def locked(path: Path) -> bool:
    """Whether a process is at work in a run's folder."""
    if not path.is_dir():
        return False
    try:
        with FileLock(path / ".lock").acquire(timeout=0):
            return False
    except Timeout:
        return True


def differences(name: str, found: Any, now: Any) -> list[str]:
    """Where two values of a manifest differ, in words."""
    if json.dumps(found) == json.dumps(now):
        return []
    if isinstance(found, dict) and isinstance(now, dict):
        return [words for key in {**found, **now} for words in differences(f"{name}.{key}", found.get(key),
                                                                           now.get(key))]
    return [f"{name} {found!r}, now {now!r}"]


class RunFolder:
    """Files of one run, each written beside and renamed.

    Raises mpm.InvalidValue where the folder holds another run, unless forced to go on with it.
    """

    def __init__(self, path: Path, manifest: dict[str, Any], force: bool = False) -> None:
        self.path, self.rows, self.best = path, [], -np.inf
        self.manifest = {**manifest, "versions": {name: version(name) for name in (
            "robosim", "numpy", "torch", "stable_baselines3", "gymnasium", "taichi")}, "machine": platform.machine()}
        self._lock = claim(path)
        try:
            self._recognise(force)
        except mpm.InvalidValue:
            self.close()
            raise
        if not self.finished or force:
            write_json(path / "manifest.json", self.manifest)

    def _recognise(self, force: bool) -> None:
        found = self.read("manifest.json")
        if found is None or force:
            return
        if isinstance(found.get("preset"), dict):
            found = {**found, "preset": known(found["preset"])}
        other = [words for key in IDENTITY for words in differences(key, found.get(key), self.manifest.get(key))]
        if other:
            raise mpm.InvalidValue(f"{self.path}: holds another run: {'; '.join(other)}; give another --out, or "
                                   f"--force to go on with it")

    def read(self, name: str) -> Any:
        """A .json file of the folder, None where there is none; raises mpm.InvalidValue where it is not JSON."""
        try:
            return json.loads((self.path / name).read_text())
        except FileNotFoundError:
            return None
        except ValueError as error:
            raise mpm.InvalidValue(f"{self.path / name}: not JSON: {error}; remove it, or give another --out"
                                   ) from error

    @property
    def checkpoint(self) -> Path:
        """Where the checkpoint is."""
        return self.path / "checkpoint.zip"

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        status = self.read("status.json")
        return status is not None and status["state"] == "finished"

    def add(self, episode: Episode, hold: int) -> bool:
        """Keep an episode; tells whether it is the best so far, whose actions are then kept too."""
        self.rows.append(episode.row)
        self._table()
        if not episode.total > self.best or episode.row["diverged"]:
            return False
        self.best = episode.total
        told = {key: np.array(episode.row[key]) for key in ("episode", "start", "return", "tcs", "needed")
                if key in episode.row}
        names = {key: np.array(self.manifest[key]) for key in ("task", "material", "method", "seed", "fingerprint")}
        write(self.path / "best.npz", partial(np.savez, actions=episode.actions.astype(np.float32),
                                              hold=np.array(hold), **told, **names,
                                              nominal=np.array(self.manifest.get("starts") == "nominal")))
        return True

    def _table(self) -> None:
        def rows(path: Path) -> None:
            with path.open("w", newline="") as file:
                names = dict.fromkeys(name for row in self.rows for name in row)  # a run that is older may lack some
                table = csv.DictWriter(file, list(names))
                table.writeheader()
                table.writerows(self.rows)

        write(self.path / "episodes.csv", rows)

    def capped(self, cap: float | None) -> bool:
        """Whether the last LAST episodes all reached the highest score there is."""
        recent = [row.get("tcs", -np.inf) for row in self.rows[-LAST:]]
        return cap is not None and len(recent) == LAST and min(recent) >= cap - 1e-9

    def close(self) -> None:
        """Let others at the folder."""
        self._lock.release()

    def status(self, state: str, **more: Any) -> None:
        """Write down how far the run got."""
        done: dict[str, Any] = {"state": state, "process": os.getpid(), "episodes": len(self.rows)}
        if self.rows:
            last = self.rows[-LAST:]
            keys = [key for key in ("return", "tcs", "delivered", "spilled", "collisions") if key in self.rows[0]]
            done["best_return"] = self.best if np.isfinite(self.best) else None
            done["last"] = {key: float(np.mean([row[key] for row in last])) for key in keys}
            done["seconds"] = sum(row["seconds"] for row in self.rows)
            done["simulating"] = sum(row["simulating"] for row in self.rows)
        write_json(self.path / "status.json", {**done, **more})
