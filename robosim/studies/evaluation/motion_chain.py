"""`robosim chain`: a rehearsal's sub-tasks in sequence, with the tool alone.

Each sub-task begins at its own start pose with what the one before left in the tool; for comparison, the same motion is
replayed from the sub-task's own settled start."""

import contextlib
import math
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import robosim.envs  # noqa: F401  (registers the ids)
from robosim.base.errors import ConfigError
from robosim.base.output_folder import OutputFolder, aligned
from robosim.base.progress import Progress
from robosim.config.rehearsal import load_rehearsal
from robosim.envs.grain_env import GrainEnv
from robosim.episode.film import CHAIN, EPISODE, try_film
from robosim.episode.play import play
from robosim.planning.recorded_motions import find_motion
from robosim.recordings.reader import Recording
from robosim.reports.page import Page
from robosim.rewards.term import find_term
from robosim.rewards.tool import Turn
from robosim.studies.evaluation.episode_recorder import EpisodeRecorder
from robosim.studies.policies.make import make_policy, training_options
from robosim.tasks.handover import Load, take_load
from robosim.viewer.server import embed_html

RESULTS = ("chain.json", "index.html", CHAIN)
"""Files that a run writes."""
STARTS = {"from_settled_start": "its own start", "from_previous": "what was left"}
"""Key of chain.json -> the start's name in the table."""


def run_chain(name: str, out: Path, *, material: str | None = None, motions: Path | None = None,
              film: bool = True) -> int:
    """Replay a rehearsal's recorded motions in sequence.
    Writes chain.json and chain.mp4 into `out`. motions: folder with TASK.npz files; None: the bundled motions. Returns
    0, or 1 where the chain broke: the field diverged, or too little was left in a tool. Raises ConfigError before any
    work."""
    chosen = {"trajectory": "recorded", "material": material, "motions": motions and str(motions)}
    config = load_rehearsal(name, {key: value for key, value in chosen.items() if value})
    paths = {task: find_motion(config, task) for task in config.recorded}
    rows, load, broken = list[dict[str, Any]](), None, ""
    with OutputFolder(out) as folder:
        folder.clear(RESULTS)
        for old in out.glob("*.rec*"):
            old.unlink()
        for task, path in Progress(paths.items(), desc="chain", unit="sub-tasks"):
            row, load, broken = _replay_sub_task(task, path, config.material, load, out / f"{len(rows) + 1}-{task}.rec")
            rows.append(row)
            if not broken and load is None and len(rows) < len(paths):
                broken = f"{task} leaves nothing in its tool"
            folder.write_json("chain.json", {"rehearsal": name, "material": config.material, "broken": broken,
                                             "is_complete": bool(broken) or len(rows) == len(paths),
                                             "sub_tasks": rows})
            if broken:
                break
        try:
            failure = try_film(folder, EPISODE) if film else None
        finally:  # an interrupted film costs no result
            folder.write_text("index.html", make_page(name, config.material, rows, broken, out).html())
    print(format_rows(rows))
    if failure is not None:
        raise failure
    if broken:
        print(f"the chain broke: {broken}", file=sys.stderr)
    return 1 if broken else 0


def _replay_sub_task(task: str, path: Path, material: str, load: Load | None,
                     recording: Path) -> tuple[dict[str, Any], Load | None, str]:
    """Replay a motion from its settled start, and with a load where there is one; record the last of them.
    Returns the row of chain.json, the load that is left, and why the chain broke, if it did."""
    figures, left = replay_motion(task, path, material=material, recording=recording if load is None else None)
    row, broken = {"task": task, "from_settled_start": figures}, ""
    if load is not None:
        try:
            figures, left = replay_motion(task, path, load=load, recording=recording)
            row["from_previous"] = figures
        except ConfigError as error:  # too few grains for this sub-task
            broken = str(error)
    if not broken and figures["diverged"]:
        broken = f"{task} diverged: {figures['diverged']}"
    return row, left, broken


def replay_motion(task: str, path: Path, *, material: str | None = None, load: Load | None = None,
                  recording: Path | None = None) -> tuple[dict[str, Any], Load | None]:
    """Replay one motion in the sub-task's environment.
    It begins at its nominal start, or with a load. Returns the episode's figures and what the tool holds after it; None
    where the field diverged or nothing is held."""
    wrapped = gymnasium.make(f"robosim/{task}-v0", material=material, load=load, **training_options(str(path)))
    env = wrapped.unwrapped
    assert isinstance(env, GrainEnv)
    observation, _ = env.reset(seed=0, options={"nominal": True})
    policy = make_policy(str(path), env, 0)
    with EpisodeRecorder(env, recording, "bundled motion") if recording else contextlib.nullcontext() as recorder:
        _, info = play(env, policy, observation=observation, hooks=[recorder.add] if recorder else [])
    lowest, highest = env.reward.extremes()
    figures = {"grains": env.task.grains.count, "score": info["tcs"], "score_min": lowest, "score_max": highest,
               **info["readings"], "diverged": info.get("diverged"), **_rotation_figures(env)}
    left = None
    if not info.get("diverged"):
        with contextlib.suppress(ConfigError):  # nothing is held
            left = take_load(env)
        figures["grains_in_tool"] = left.count if left else 0
    wrapped.close()
    return figures, left


def _rotation_figures(env: GrainEnv) -> dict[str, float]:
    """The tool's rotation in a sub-task that requires one; empty for others."""
    turn = find_term(env.task.reward, Turn)
    if turn is None:
        return {}
    angle = math.degrees(env.episode.tool_rotation())
    error = abs(np.remainder(angle - turn.angle_deg + 180, 360) - 180)
    return {"rotation_deg": angle, "required_rotation_deg": turn.angle_deg,
            "rotation_relative_error": error / abs(turn.angle_deg)}


def make_page(name: str, material: str, rows: list[dict[str, Any]], broken: str, folder: Path) -> Page:
    """Make the page of a chain: verdict, film, a recording of each sub-task, figures."""
    page = Page(f"{name} in sequence: {material}")
    page.set_verdict(f"the chain broke: {broken}" if broken else f"{len(rows)} sub-tasks in sequence", holds=not broken)
    if (folder / CHAIN).is_file():
        page.add_film((folder / CHAIN).read_bytes(), "All sub-tasks, each with what the one before left.")
    for path in sorted(folder.glob("*.rec")):
        with Recording(path) as recording:
            page.add_heading(path.stem.split("-", 1)[-1])
            page.add_scene(embed_html(recording), f"robosim view {path}")
    page.add_heading("Figures")
    names = list(dict.fromkeys(key for row in rows for start in STARTS for key in row.get(start, {})))
    page.add_table(["sub-task", "from", *names], [[row["task"], text, *(row[start].get(key) for key in names)]
                                                  for row in rows for start, text in STARTS.items() if start in row])
    return page


def format_rows(rows: list[dict[str, Any]]) -> str:
    """Format the rows of chain.json as a table, with a line for each start of each sub-task."""
    lines = [["sub-task", "from", "grains", "score", "of", "delivered", "spilled", "grains in tool", "rotation [deg]"]]
    for row in rows:
        for key, start in STARTS.items():
            if key in row:
                v = row[key]
                rotation = (f"{v['rotation_deg']:.1f} of {v['required_rotation_deg']:.0f} "
                            f"({100 * v['rotation_relative_error']:.1f} %)") if "rotation_deg" in v else ""
                lines.append([row["task"], start, str(v["grains"]), f"{v['score']:.2f}", f"{v['score_max']:.2f}",
                              f"{v['delivered']:.3f}", f"{v['spilled']:.3f}", str(v.get("grains_in_tool", "")),
                              rotation])
    return aligned(lines)
