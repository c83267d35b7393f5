"""The folder of a run.
manifest.json says what the run is, status.json how far it has come; episodes.csv has its episodes, best.npz the actions
of the best one, checkpoint.zip its last checkpoint."""

import json
import platform
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

import mpm
from mpm.files import write
from policies.runs.episodes import Episode
from robosim.base.files import write_json, write_rows, write_status
from robosim.base.input_files import check_form, differing_entries, read_json
from robosim.base.output_folder import OutputFolder

IDENTITY = ("method", "preset", "task", "material", "seed", "starts", "action_repeat", "n_envs", "fingerprint",
            "demonstrations", "commit")
"""Entries of a manifest that a run must share with the run that its folder holds."""
LAST = 10
"""Episodes at the end whose mean the paper reports."""


class RunFolder:
    """The files of one run; its lock keeps other processes out until `close`.
    Raises mpm.InvalidValue where the folder holds another run, unless `force`."""

    def __init__(self, path: Path, manifest: dict[str, Any], force: bool = False) -> None:
        self.path, self.best_return = path, -np.inf
        self.checkpoint, self.event_log = path / "checkpoint.zip", path / "events.out.tfevents"
        self.rows: list[dict[str, Any]] = []
        self.manifest = {**manifest, "versions": {name: version(name) for name in (
            "robosim", "numpy", "torch", "stable_baselines3", "gymnasium", "taichi")}, "machine": platform.machine()}
        self._lock = OutputFolder(path)
        self.close = self._lock.release
        try:
            stored = self.read_json("manifest.json")
            before, now = ({key: one.get(key) for key in IDENTITY} for one in (
                stored, json.loads(json.dumps(self.manifest))))
            differences = [f"{key} {one!r}, now {other!r}" for key, (one, other) in
                           differing_entries(before, now).items()]
            if stored and differences and not force:
                raise mpm.InvalidValue(f"{path}: holds another run: {'; '.join(differences)}; give another --out, or "
                                       f"--force to continue it")
            if not self.is_finished or force:
                write_json(path / "manifest.json", self.manifest)
        except BaseException:
            self.close()
            raise

    def read_json(self, name: str) -> dict[str, Any]:
        """Return a .json file's table, {} without a file; raises mpm.InvalidValue where it is none."""
        try:
            stored = read_json(self.path / name) if (self.path / name).is_file() else {}
            check_form(stored, {}, str(self.path / name))
            return stored
        except ValueError as error:
            raise mpm.InvalidValue(f"{error}; remove it, or give another --out") from None

    @property
    def is_finished(self) -> bool:
        """Whether the run has come to its end."""
        return self.read_json("status.json").get("state") == "finished"

    def add(self, episode: Episode, action_repeat: int) -> bool:
        """Add an episode; return whether it is the best so far, whose actions are then written to best.npz."""
        self.rows.append(episode.row)
        self.write_episodes()
        if not episode.row["return"] > self.best_return or episode.row["diverged"]:
            return False
        self.best_return = episode.row["return"]
        figures = {key: np.array(episode.row[key]) for key in ("episode", "start", "return", "tcs", "needed")
                   if key in episode.row}
        origin = {key: np.array(self.manifest[key]) for key in ("task", "material", "method", "seed", "fingerprint")
                  if self.manifest[key] is not None}  # it would be pickled
        write(self.path / "best.npz", partial(np.savez, actions=episode.actions.astype(np.float32),
                                              action_repeat=np.array(action_repeat), **figures, **origin,
                                              nominal=np.array(self.manifest.get("starts") == "nominal")))
        return True

    def write_episodes(self) -> None:
        """Write episodes.csv."""
        write_rows(self.path / "episodes.csv", self.rows)

    def write_status(self, state: str, **more: Any) -> None:
        """Write status.json: the state, figures of the episodes so far, and more."""
        status: dict[str, Any] = {"episodes": len(self.rows)}
        if self.rows:
            last = self.rows[-LAST:]
            keys = [key for key in ("return", "tcs", "delivered", "spilled", "collisions") if key in self.rows[0]]
            status["best_return"] = self.best_return if np.isfinite(self.best_return) else None
            status["last"] = {key: float(np.mean([row[key] for row in last])) for key in keys}
            total, simulating, updating = (sum(row.get(key, 0.0) for row in self.rows)
                                           for key in ("seconds", "simulating", "updating"))
            status |= {"seconds": total, "simulating_s": simulating, "updating_s": updating,
                       "rest_s": total - simulating - updating - more.get("evaluating_s", 0.0)}
        write_status(self.path, state, **status, **more)

    def update_status(self, state: str, **more: Any) -> None:
        """Write status.json with the figures that it has."""
        write_status(self.path, state, **{key: value for key, value in self.read_json("status.json").items()
                                          if key not in ("state", "process", "reason")} | more)
