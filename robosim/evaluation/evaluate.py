"""`robosim evaluate`: episodes of a policy on a sub-task, their scores as table, JSON and film."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from robosim.config.output import OutputFolder
from robosim.envs import make
from robosim.envs.grain_env import GrainEnv
from robosim.evaluation.policies import learnt_with, policy
from robosim.rendering.renderer import RenderingUnavailable
from robosim.rendering.video import Mp4Writer


def evaluate(task: str, name: str, out: Path | None, *, episodes: int | None = None, seed: int = 0, film: bool = True,
             nominal: bool = False, **options: Any) -> int:
    """Run episodes with seeds from `seed` on, or from the task's own start (None: five, or the one of them all that
    begin alike); options go to the environment, which sees and holds as a policy's file says. Returns 0."""
    episodes = episodes or (1 if nominal else 5)
    options |= learnt_with(name)
    made = make(task, render_mode="rgb_array" if film and out else None, **options)
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    policy(name, env, seed)  # complain before any work
    folder = OutputFolder(out) if out else None
    if folder:
        folder.clear(("episode.mp4",))
    rows = []
    try:
        for k in tqdm(range(episodes), desc=f"{task}, {name}", file=sys.stderr):
            writer = _writer(folder, env) if k == 0 and film else None
            rows.append(_episode(env, name, seed + k, writer, nominal))
            if folder:
                folder.write_json("evaluation.json", summary(task, name, rows))
    finally:
        made.close()
    values = summary(task, name, rows)
    for key in ("return", "tcs", "success_rate", *(k for k in values if k.startswith(("readings.", "arm.")))):
        print(f"{key:28s} {values[key]}")
    return 0


def _writer(folder: OutputFolder | None, env: GrainEnv) -> Mp4Writer | None:
    """The film's writer, or None with a word on why."""
    if folder is None:
        return None
    try:
        env.render()
    except RenderingUnavailable as error:
        print(f"no film: {error}", file=sys.stderr)
        return None
    return Mp4Writer(folder.path / "episode.mp4", fps=env.metadata["render_fps"])


def _episode(env: GrainEnv, name: str, seed: int, writer: Mp4Writer | None, nominal: bool) -> dict[str, Any]:
    """One episode's figures; the film gets a frame per action."""
    env.reset(seed=seed, options={"nominal": nominal})
    act, total, over, info = policy(name, env, seed), 0.0, False, {}
    actions = []
    try:
        while not over:
            actions.append(act())
            _, reward, terminated, truncated, info = env.step(actions[-1])
            total, over = total + reward, terminated or truncated
            if writer is not None and (frame := env.render()) is not None:
                writer.add(frame)
    finally:
        if writer is not None:
            writer.close()
    return {"seed": seed, "return": total, "tcs": info["tcs"], "tcs_terms": info["tcs_terms"],
            "is_success": info["is_success"], "readings": info["readings"], "diverged": info.get("diverged"),
            **({"arm": info["arm"]} if "arm" in info else {})}


def summary(task: str, name: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Means and standard deviations over episodes, and the episodes."""
    values: dict[str, Any] = {"task": task, "policy": name, "episodes": rows}
    for key in ("return", "tcs"):
        numbers = [row[key] for row in rows]
        values[key], values[f"{key}_std"] = float(np.mean(numbers)), float(np.std(numbers))
    values["success_rate"] = float(np.mean([row["is_success"] for row in rows]))
    for key in rows[0]["readings"]:
        values[f"readings.{key}"] = float(np.mean([row["readings"][key] for row in rows]))
    for key in rows[0].get("arm", ()):  # what one episode alone asks of the arm is asked
        values[f"arm.{key}"] = max(row["arm"][key] for row in rows)
    return values
