"""`robosim chain`: the sub-tasks of a rehearsal one after the other, the tool alone; each begins at its own start with
what the one before has left in the tool. Beside it stands the same motion from the sub-task's own settled start.
"""

import math
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from tqdm import tqdm

import robosim.envs  # noqa: F401  (registers the ids)
from robosim.config.output import OutputFolder, aligned
from robosim.config.rehearsal import load_rehearsal
from robosim.envs.grain_env import GrainEnv
from robosim.errors import ConfigError
from robosim.evaluation.policies import make_policy, training_options
from robosim.rehearsal.learned import shipped
from robosim.rendering.renderer import RenderingUnavailable
from robosim.rendering.video import Mp4Writer
from robosim.tasks.handover import Load, take_load

FRAME_RATE = 50
"""Frames a second: one for each action of ten steps of 2 ms."""
RESULTS = ("chain.json", "chain.mp4")


def chain(name: str, out: Path, *, material: str | None = None, motions: Path | None = None, film: bool = True) -> int:
    """Play a rehearsal's learnt motions, those of a folder (TASK.npz) or those that ship, among grains of a material;
    write chain.json and chain.mp4; returns 0, or 1 where the chain broke: a field diverged, or a tool was left with too
    little."""
    chosen = {"trajectory": "learned", "material": material, "motions": motions and str(motions)}
    config = load_rehearsal(name, {key: value for key, value in chosen.items() if value})
    paths = {task: shipped(config, task) for task in config.learned}  # complain before any work
    folder = OutputFolder(out)
    folder.clear(RESULTS)
    writer = Mp4Writer(out / "chain.mp4", fps=FRAME_RATE) if film else None
    rows: list[dict[str, Any]] = []
    load: Load | None = None
    broken = ""
    try:
        for task, path in tqdm(paths.items(), unit="sub-task", file=sys.stderr):
            own, left = played(task, path, material=config.material, writer=None if rows else writer)
            row: dict[str, Any] = {"task": task, "own_start": own}
            try:
                if load is not None:
                    row["handed_over"], left = played(task, path, load=load, writer=writer)
            except ConfigError as error:  # too few grains for it
                broken = str(error)
            rows.append(row)
            went = row.get("handed_over", own)
            broken = broken or (f"{task} diverged: {went['diverged']}" if went["diverged"] else "")
            if left is None and len(rows) < len(paths):
                broken = broken or f"{task} leaves nothing in its tool"
            folder.write_json("chain.json", {"rehearsal": name, "material": config.material, "broken": broken,
                                             "sub_tasks": rows})
            load = left
            if broken:
                break
    finally:
        if writer is not None:
            writer.close()
    print(as_text(rows))
    if broken:
        print(f"the chain broke: {broken}", file=sys.stderr)
    return 1 if broken else 0


def played(task: str, path: Path, *, material: str | None = None, load: Load | None = None,
           writer: Mp4Writer | None = None) -> tuple[dict[str, Any], Load | None]:
    """Figures of an episode, and what the tool holds after it; None where the field diverged, or nothing is held."""
    made = gymnasium.make(f"robosim/{task}-v0", material=material, load=load,
                          render_mode="rgb_array" if writer else None, **training_options(str(path)))
    env = made.unwrapped
    assert isinstance(env, GrainEnv)
    env.reset(seed=0, options={"nominal": True})
    act, over, info = make_policy(str(path), env, 0), False, {}
    while not over:
        _, _, ended, cut, info = env.step(act())
        over = ended or cut
        if writer is not None:
            writer = shown(env, writer)
    worst, best = env.reward.extremes()
    values = {"grains": env.task.grains.count, "score": info["tcs"], "none": worst, "perfect": best,
              **info["readings"], "diverged": info.get("diverged")}
    turn = env.task.reward.turn
    if turn is not None:
        angle = math.degrees(env.episode.tool_rotation())
        values |= {"turned_deg": angle, "wanted_deg": turn.angle_deg,
                   "relative_turn_error": abs(np.remainder(angle - turn.angle_deg + 180, 360) - 180)
                   / abs(turn.angle_deg)}
    left = None
    if not info.get("diverged"):
        try:
            left = take_load(env)
            values["held"] = left.count
        except ConfigError:
            values["held"] = 0
    made.close()
    return values, left


def shown(env: GrainEnv, writer: Mp4Writer) -> Mp4Writer | None:
    """Add a frame; None, and a word on why, where none can be drawn."""
    try:
        frame = env.render()
    except RenderingUnavailable as error:
        print(f"no film: {error}", file=sys.stderr)
        return None
    if frame is not None:
        writer.add(frame)
    return writer


def as_text(rows: list[dict[str, Any]]) -> str:
    """A line for each start of each sub-task."""
    lines = [["sub-task", "from", "grains", "score", "of", "delivered", "spilled", "held after", "turned [deg]"]]
    for row in rows:
        for start, words in (("own_start", "its own start"), ("handed_over", "what was left")):
            if start in row:
                v = row[start]
                turned = f"{v['turned_deg']:.1f} of {v['wanted_deg']:.0f} ({100 * v['relative_turn_error']:.1f} %)" \
                    if "turned_deg" in v else ""
                lines.append([row["task"], words, str(v["grains"]), f"{v['score']:.2f}", f"{v['perfect']:.2f}",
                              f"{v['delivered']:.3f}", f"{v['spilled']:.3f}", str(v.get("held", "")), turned])
    return aligned(lines)
