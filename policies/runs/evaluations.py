"""Episodes of a run's deterministic policy, between those in which it explores: what the best policy is judged by."""

import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import mpm
from robosim.base.files import write_rows
from robosim.episode.play import play, read_scores

HELD_OUT, RANDOM_STARTS = 2_000_000, 5
"""Seed of the first start and number of starts, where the run's own are random. Training draws its seeds from all
32-bit numbers, the suites of `robosim evaluate` have others."""
SATURATED, PATIENCE = 0.999, 3
"""Size of an action that counts as saturated; evaluations in a row without another one after which a run has failed."""

Row = dict[str, Any]


class SaturatedActor(mpm.MpmError, RuntimeError):
    """The policy gives the same extreme action always; no update will move it any more."""


class Evaluations:
    """Evaluates a policy in the run's own environment, whose running episode it puts back as it was.
    Nothing of the run depends on it: neither random numbers nor episodes. env: without what counts the run's episodes.
    folder: of the run, whose evaluations.csv has a row each. every: episodes between two. options: of every reset; the
    task's own start needs one episode. is_running: whether the run's episodes are in `env`, too."""

    def __init__(self, env: gymnasium.Env, folder: Path, every: int, options: dict[str, Any] | None,
                 is_running: bool = True) -> None:
        self.env, self.folder, self.every, self._options, self._is_running = env, folder, every, options, is_running
        self.seeds = [HELD_OUT] if options else [HELD_OUT + k for k in range(RANDOM_STARTS)]
        self.rows: list[Row] = []

    def is_due(self, count: int, is_over: bool) -> bool:
        """Return whether a policy is to be evaluated after `count` episodes of the run."""
        done = self.rows[-1]["episode"] if self.rows else 0
        return count > done and (count >= done + self.every or is_over)

    def add(self, policy: Any, count: int) -> bool:
        """Evaluate a policy after `count` episodes; return whether it is the best so far. Raises SaturatedActor."""
        raw: Any = self.env.unwrapped
        state, began = raw.state() if self._is_running else None, time.perf_counter()
        try:
            episodes = [self._play(policy, seed) for seed in self.seeds]
        finally:
            if state is not None:
                raw.load(state)
        row = {"episode": count, "episodes": len(episodes),
               **{key: float(np.mean([episode[key] for episode in episodes])) for key in episodes[0]},
               "seconds": round(time.perf_counter() - began, 3)}
        best = max((self._rank(row) for row in self.rows), default=(-np.inf, -np.inf))
        self.rows.append(row)
        self.write_rows()
        if len(self.rows) >= PATIENCE and min(row["saturated"] for row in self.rows[-PATIENCE:]) == 1.0:
            raise SaturatedActor(f"the last {PATIENCE} evaluations have one action alone, and that at the end of its "
                                 f"range in every dimension: the policy does not learn any more; accepted: a smaller "
                                 f"learning_rate, critic_layer_norm or observations that are scaled")
        return self._rank(row) > best

    def _play(self, policy: Any, seed: int) -> dict[str, float]:
        """Play an episode; return its figures."""
        actions: list[np.ndarray] = []
        total, info = play(self.env, lambda observation: policy.predict(observation, deterministic=True)[0],
                           hooks=[lambda step: actions.append(step.action)], seed=seed, options=self._options)
        is_stuck = bool(np.all(np.abs(actions) > SATURATED) and np.ptp(actions, axis=0).max() < 1e-6)
        return {"return": total, **{key: float(value) for key, value in read_scores(info).items()},
                "saturated": float(is_stuck)}

    @staticmethod
    def _rank(row: Row) -> tuple[float, float]:
        """Return what the better of two has more of: score, then return."""
        return row.get("tcs", -np.inf), row["return"]

    @property
    def summary(self) -> dict[str, Any]:
        """The last and the best row, for the run's status."""
        return {"last": self.rows[-1], "best": max(self.rows, key=self._rank)} if self.rows else {}

    def write_rows(self) -> None:
        """Write evaluations.csv."""
        if self.rows:
            write_rows(self.folder / "evaluations.csv", self.rows)
