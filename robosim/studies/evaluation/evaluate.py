"""`robosim evaluate`: episodes of a policy on a sub-task, their scores as text and JSON, and a film of the first."""

import contextlib
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

from robosim.base.output_folder import OutputFolder
from robosim.base.progress import Progress
from robosim.envs import make
from robosim.envs.grain_env import GrainEnv
from robosim.episode.film import EPISODE, try_film
from robosim.episode.play import play
from robosim.recordings.reader import FILE as RECORDING
from robosim.studies.evaluation.episode_recorder import EpisodeRecorder
from robosim.studies.evaluation.page import make_page, short_name
from robosim.studies.policies.make import check_task, make_policy, training_options
from robosim.tasks.task import load_task

RESULTS = ("evaluation.json", "index.html", "episode.mp4", RECORDING)
"""Files that a run writes."""


def evaluate(task: str, name: str, out: Path | None, *, episodes: int | None = None, seed: int = 0, film: bool = True,
             nominal: bool = False, changed: Collection[str] = (), **options: Any) -> int:
    """Run episodes of a policy, print their scores, and write evaluation.json and episode.mp4 into a folder.

    name: of the policy, or its file, whose own options of the environment prevail. episodes: None: five, or one where
    all are the same because they begin at the task's own start (nominal). seed: of the first; the next one's is one
    higher. changed: top-level keys of the task that differ on purpose from what the policy was learned on. options: of
    the environment. Returns 0. Raises ConfigError, UnknownName for what cannot be used, before any work."""
    episodes = episodes or (1 if nominal else 5)
    options |= training_options(name)
    check_task(name, load_task(task), changed, options.get("arm") or None)
    made = make(task, **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    make_policy(name, env, seed)  # raises for a policy that does not fit
    rows, failure = list[dict[str, Any]](), None
    with contextlib.ExitStack() as stack:
        stack.callback(made.close)
        folder = stack.enter_context(OutputFolder(out)) if out else None
        if folder:
            folder.clear(RESULTS)
        for k in Progress(range(episodes), desc=f"{task}, {name}", unit="episodes"):
            rows.append(_score_episode(env, name, seed + k, nominal, folder if k == 0 else None))
            if folder:
                folder.write_json("evaluation.json", summarize(task, name, rows, episodes))
        values = summarize(task, name, rows, episodes)
        if folder:
            try:
                failure = try_film(folder, EPISODE) if film else None
            finally:  # an interrupted film costs no result
                folder.write_text("index.html", make_page(values, folder.path).html())
    for key in ("return", "tcs", "success_rate", *(k for k in values if k.startswith(("readings.", "arm.")))):
        print(f"{key:28s} {values[key]:.4g}{' deg' if key.endswith('_deg') else ''}")
    if failure is not None:
        raise failure
    return 0


def _score_episode(env: GrainEnv, name: str, seed: int, nominal: bool, folder: OutputFolder | None) -> dict[str, Any]:
    """Play one episode and return its figures; a recording in a folder takes a frame after each action."""
    observation, _ = env.reset(seed=seed, options={"nominal": nominal})
    policy = make_policy(name, env, seed)
    recording = EpisodeRecorder(env, folder.path / RECORDING, short_name(name)) if folder else None
    with recording or contextlib.nullcontext() as recorder:
        total, info = play(env, policy, observation=observation, hooks=[recorder.add] if recorder else [])
    return {"seed": seed, "return": total, "tcs": info["tcs"], "tcs_terms": info["tcs_terms"],
            "is_success": info["is_success"], "readings": info["readings"], "diverged": info.get("diverged"),
            **({"arm": info["arm"]} if "arm" in info else {})}


def summarize(task: str, name: str, rows: list[dict[str, Any]], planned: int) -> dict[str, Any]:
    """Return means and standard deviations over episodes, and the episodes' own figures.
    planned: number of episodes; the summary says whether it is of all of them.
    Readings of the arm are the largest of all episodes, because a single one may exceed a limit."""
    values: dict[str, Any] = {"task": task, "policy": name, "is_complete": len(rows) == planned, "episodes": rows}
    for key in ("return", "tcs"):
        numbers = [row[key] for row in rows]
        values[key], values[f"{key}_std"] = float(np.mean(numbers)), float(np.std(numbers))
    values["success_rate"] = float(np.mean([row["is_success"] for row in rows]))
    for key in rows[0]["readings"]:
        values[f"readings.{key}"] = float(np.mean([row["readings"][key] for row in rows]))
        if key.startswith("dose_error"):
            values[f"readings.{key}_std"] = float(np.std([row["readings"][key] for row in rows]))
    for key in rows[0].get("arm", ()):
        values[f"arm.{key}"] = max(row["arm"][key] for row in rows)
    return values
