"""Run the commands whose results the pages quote, and store these in docs/results/data: `python docs/measure.py NAME`.

Names: rehearsal_spoon (and the pictures of it), gallery (stills of the other rehearsals, and eight loops), arms (three
rehearsals with every arm, with its hand and without), foreign_arms (the spoon with arms of other packages, which
docs/developer/testing.md says how to get), report, stability, bench, bench_field, networks (the bundled policies and
their scores) and tables (the paper's): hours and days, which continue where they were interrupted. Without a name:
all but these two.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE), str(HERE.parent / "tests")]

from foreign_arms import ARMS as FOREIGN  # noqa: E402
from foreign_arms import find_arm  # noqa: E402
from generators.results.measured import DATA  # noqa: E402

from robosim.base.digests import code_digest  # noqa: E402
from robosim.base.provenance import provenance  # noqa: E402

IMAGES = HERE / "images"
POSTERS = {"spoon": 8.85, "scoop": 9.4, "bottle": 3.9, "shovel": 2.8}
"""Rehearsal -> time [s] of its still: grains fall, or move."""
LOOPS = {
    "spoon": (["rehearse", "spoon", "--no-video"], "close", 7.6),
    "scoop": (["rehearse", "scoop", "--no-video"], "close", 2.4),
    "bottle": (["rehearse", "bottle", "--no-video"], "close", 2.6),
    "shovel": (["rehearse", "shovel", "--no-video"], "close", 1.6),
    "dose_spoon": (["rehearse", "dose_spoon", "--no-video"], "close", 5.0),
    "ur5e": (["rehearse", "spoon", "--no-video", "--set", "robot=ur5e", "--material", "sugar"], "auto", 2.6),
    "water": (["evaluate", "ScoopPour", "--policy", "scripted", "--episodes", "1", "--material", "water",
               "--no-video"], "task", 0.2),
    "push": (["evaluate", "ShovelMove", "--policy", "network", "--episodes", "1", "--no-video"], "task", 0.0)}
"""Loop of the gallery -> command whose run it shows, camera, and time [s] at which it begins."""
LOOP_SECONDS, LOOP_RATE = 3.0, 12
CASES = ["free_fall", "bar", "spin", "uniaxial", "column_weight", "hydrostatic", "return_mapping", "element_path",
         "closed_system", "block_at_rest", "ik_poses", "jerk_limits", "two_models"]
"""Cases of the stored report: a subject each from continuum, fluid, grains, coupling and robot."""
AXES = ["courant", "friction_angle_deg", "mass_ratio", "lagged_mass_ratio", "rest"]
SIZES = ["300", "2880", "50000"]


def command(words: list[str], out: Path) -> float:
    """Run `robosim WORDS --out OUT`; the seconds that it took."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "robosim", *words, "--out", str(out)], cwd=HERE.parent, check=False)
    return time.perf_counter() - begin


def made_by(words: list[str]) -> dict[str, str]:
    """Command, commit and machine."""
    return {**provenance(), "command": " ".join(["robosim", *words])}


def rehearsal_spoon(out: Path) -> dict[str, Any]:
    """The figures of the report, and three pictures."""
    words = ["rehearse", "spoon", "--poster", str(POSTERS["spoon"])]
    seconds = command(words, out)
    figures = json.loads((out / "report.json").read_text())
    pictures(out)
    quoted = {"spoon_seconds": f"{60 * round(seconds / 60):.0f}", "spoon_minutes": f"{seconds / 60:.0f}",
              "spoon_simulated": f"{figures['simulated_time_s']:.1f}",
              "spoon_load_g": f"{1e3 * figures['scooped_mass_kg']:.0f}", "spoon_grains": f"{figures['grains']}",
              "spoon_delivered": f"{figures['delivered_fraction']:.3f}",
              "spoon_spilled": f"{figures['spilled_fraction']:.3f}",
              "spoon_residual": f"{figures['momentum_residual']:.0e}",
              "spoon_torque": f"{figures['torque_limit_ratio_max']:.2f}",
              "spoon_speed": f"{figures['velocity_limit_ratio_max']:.2f}",
              "spoon_tracking_mm": f"{1e3 * figures['tool_tracking_error_max_m']:.1f}"}
    return {"made_by": made_by([*words, "--out", "out/spoon"]), "code": code_digest("robosim.commands.runs.rehearse"),
            "seconds": seconds, "figures": figures, "quoted": quoted}


def pictures(out: Path) -> None:
    """The still, the sheet of nine, the page of curves; small enough for a repository."""
    from PIL import Image

    IMAGES.mkdir(exist_ok=True)
    still(out, "spoon")
    sheet = Image.open(out / "frames.png").convert("RGB")
    sheet.resize((1440, 810)).save(IMAGES / "spoon_sheet.jpg", quality=80, optimize=True)
    if shutil.which("chromium") is None:
        print("spoon_report.png is left as it is: it needs Chromium, which is not installed", file=sys.stderr)
        return
    picture_of_page(out / "index.html", out / "page.png")
    curves = Image.open(out / "page.png").convert("RGB").quantize(64)
    curves.save(IMAGES / "spoon_report.png", optimize=True)


def draw(run: Path, out: Path, camera: str, begin: float, end: float, *more: str) -> None:
    """Draw a part of a run's film. DRAW in the environment: an interpreter with MuJoCo 4, which does so by Filament."""
    words = ["film", str(run), "--camera", camera, "--height", "540", "--begin", str(begin), "--end", str(end), *more]
    subprocess.run([os.environ.get("DRAW", sys.executable), "-m", "robosim", *words, "--out", str(out)],
                   cwd=HERE.parent, check=True)


def still(run: Path, name: str) -> None:
    """The still of a rehearsal."""
    from PIL import Image

    moment, out = POSTERS[name], run / "still"
    draw(run, out, "auto" if name == "spoon" else "close", moment, moment + 0.1, "--poster", str(moment))
    poster = Image.open(out / "poster.png").convert("RGB")
    poster.resize((1280, 720), Image.Resampling.LANCZOS).save(IMAGES / f"{name}.jpg", quality=84, optimize=True)


def gallery(out: Path) -> None:
    """Stills of the rehearsals besides the spoon's, and the loops."""
    for name, (words, camera, begin) in LOOPS.items():
        run = out / name
        command(words, run)
        draw(run, run / "loop", camera, begin, begin + LOOP_SECONDS)
        loop(next((run / "loop").glob("*.mp4")), IMAGES / f"{name}.webp")
        if name in POSTERS and name != "spoon":
            still(run, name)


def loop(film: Path, out: Path) -> None:
    """Write a film as a picture that moves."""
    from PIL import Image

    from robosim.rendering.video import read_frames

    frames = [Image.fromarray(frame).resize((480, 270), Image.Resampling.LANCZOS)
              for frame in read_frames(film, round(LOOP_SECONDS * LOOP_RATE))]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=round(1000 / LOOP_RATE), loop=0, quality=60,
                   method=6)


ARMS = {"gen3": "Kinova Gen3", "iiwa14": "KUKA LBR iiwa 14", "panda": "Franka Panda", "ur5e": "Universal Robots UR5e",
        "xarm7": "UFACTORY xArm7"}
FIGURES = {"delivered_fraction": "{:.3f}", "spilled_fraction": "{:.3f}", "tool_tracking_error_max_m": "{:.5f}",
           "torque_limit_ratio_max": "{:.2f}", "velocity_limit_ratio_max": "{:.2f}", "motion_time_scale": "{:.2f}",
           "grip_turn_deg": "{:.0f}", "planned_self_clearance_m": "{:.3f}", "wall_time_s": "{:.0f}"}
"""Of the report of a rehearsal with one of the arms -> form in the table."""


def arms(out: Path) -> dict[str, Any]:
    """Rehearsals with every arm, and a picture of the arms at work."""
    rows = []
    for arm, name in ARMS.items():
        for gripper in ("null", "none"):
            for rehearsal in ("spoon", "scoop", "shovel"):
                folder = out / f"{arm}_{gripper}_{rehearsal}"
                command(["rehearse", rehearsal, "--no-video", "--set", f"robot={arm}", "--set", f"gripper={gripper}"],
                        folder)
                figures = json.loads((folder / "report.json").read_text())
                rows.append([name, figures["gripper"], rehearsal, "; ".join(figures["missed"]) or "all",
                             *(form.format(figures[key]) for key, form in FIGURES.items())])
    picture_of_arms()
    words = ["rehearse", "REHEARSAL", "--no-video", "--set", "robot=ARM", "--set", "gripper=GRIPPER"]
    return {"made_by": made_by(words),
            "code": code_digest("robosim.commands.runs.rehearse"),
            "head": ["arm", "gripper", "rehearsal", "bounds held", *FIGURES], "rows": rows}


FOREIGN_FIGURES = {key: FIGURES.get(key, "{:.1f}") for key in (
    "tool_tracking_error_max_m", "delivered_fraction", "spilled_fraction", "torque_limit_ratio_max",
    "velocity_limit_ratio_max", "motion_time_scale", "plan_time_s")}


def foreign_arms(out: Path) -> dict[str, Any]:
    """The spoon's rehearsal with each arm of tests/foreign_arms.yaml whose package is there; the lines of refusals."""
    import yaml

    from robosim import Rehearsal
    from robosim.base.errors import ConfigError

    rows, refused = [], []
    for name, arm in FOREIGN.items():
        robot = find_arm(name)
        if robot is None:
            print(f"{name}: {arm['package']} is not there")
            continue
        (out / f"{name}.yaml").write_text(yaml.safe_dump(robot))
        try:
            Rehearsal("spoon", robot=robot, gripper="none").plan()
        except ConfigError as error:
            line = re.sub(r"\S*/", "", str(error).partition("; accepted")[0])  # names of files without their folders
            refused.append([arm["arm"], arm["package"], line])
            continue
        command(["rehearse", "spoon", "--no-video", "--set", f"robot={out / name}.yaml", "--set", "gripper=none"],
                out / name)
        if not (out / name / "report.json").exists():  # the arm diverged
            reason = json.loads((out / name / "status.json").read_text())["reason"]
            rows.append([arm["arm"], arm["package"], reason, *["-"] * len(FOREIGN_FIGURES)])
            continue
        figures = json.loads((out / name / "report.json").read_text())
        rows.append([arm["arm"], arm["package"], "; ".join(figures["missed"]) or "all",
                     *(form.format(figures[key]) for key, form in FOREIGN_FIGURES.items())])
    words = ["rehearse", "spoon", "--no-video", "--set", "robot=ARM.yaml", "--set", "gripper=none"]
    return {"made_by": made_by(words), "code": code_digest("robosim.commands.runs.rehearse"),
            "head": ["arm", "package", "bounds held", *FOREIGN_FIGURES], "rows": rows,
            "refused_head": ["arm", "package", "refused"], "refused": refused}


def picture_of_arms() -> None:
    """Draw every arm with its hand while it digs, and without while it pours."""
    import mujoco
    import numpy as np
    from PIL import Image

    from robosim.config.rehearsal import load_rehearsal
    from robosim.planning.plan import plan_motion
    from robosim.rendering.renderer import SceneRenderer
    from robosim.scene.build import compile_rehearsal

    rows = []
    for gripper, waypoint in ((None, "dig"), ("none", "tilt")):
        rows.append([])
        for arm in ARMS:
            plan = plan_motion(load_rehearsal("spoon", {"robot": arm, "gripper": gripper}))
            scene = compile_rehearsal(plan.config)
            data, renderer = mujoco.MjData(scene.model), SceneRenderer(scene.model, 0, 440, 480)
            data.qpos[scene.arm_qpos] = plan.motion.state(plan.path.times[waypoint]).q
            mujoco.mj_forward(scene.model, data)
            rows[-1].append(renderer.draw(data, None, "overview"))
            renderer.close()
    picture = Image.fromarray(np.concatenate([np.concatenate(row, 1) for row in rows], 0))
    picture.resize((1440, 528), Image.Resampling.LANCZOS).save(IMAGES / "arms.jpg", quality=84, optimize=True)


def picture_of_page(page: Path, out: Path) -> None:
    """Draw the curves of a run's page in Chromium."""
    script = ("<script>for (const part of document.querySelectorAll('main > *')) "
              "if (!part.querySelector('.plotly-graph-div')) part.remove(); document.querySelector('header').remove(); "
              "window.dispatchEvent(new Event('resize'))</script></body>")
    cut = out.with_suffix(".html")
    cut.write_text(page.read_text().replace("</body>", script))
    subprocess.run(["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1180,1780",
                    "--virtual-time-budget=8000", f"--screenshot={out}", cut.resolve().as_uri()], check=True)


WHOLE = {"report": [*CASES, "--quick"], "stability": AXES,
         "bench": ["coupling", "kinematics", "SpoonPour", "ShovelMove", "arm_SpoonPour"]}
"""Command whose file is stored as it is -> its words."""


def whole(name: str, out: Path) -> dict[str, Any]:
    """What one of these commands wrote."""
    words = [name, *WHOLE[name]]
    command(words, out)
    data = json.loads((out / f"{name}.json").read_text())
    return {**data, "made_by": made_by([*words, "--out", f"out/{name}"])}


def bench_field(out: Path) -> dict[str, Any]:
    """Substeps of the field alone."""
    words = ["bench", "field", "--sizes", *SIZES]
    command(words, out)
    lines = json.loads((out / "bench_field.json").read_text())
    rows = [[line["scene"], line["grains"], line["threads"], line["arch"], line.get("ns")] for line in lines]
    return {"made_by": made_by([*words, "--out", "out/bench"]), "code": code_digest("robosim.studies.benchmarks.field"),
            "head": ["scene", "particles", "threads", "device", "ns per particle and substep"], "rows": rows}


SCORED = {"wide": ["--suite", "wide"], "hard": ["--suite", "hard"],
          **{f"wide_{arm}": ["--suite", "wide", "--alone", "--arm", "--robot", arm] for arm in ("iiwa14", "ur5e")}}
"""End of a file with scores -> arguments of `robosim evaluate`: the tool alone, and two arms from the same starts."""
EPISODES = 30


def networks(_: Path) -> None:
    """Train the sweep of the bundled policies, take the best of finished runs, and score those of a task.
    The first seed's policy is bundled; scores are those of all seeds."""
    from generators.results.learning import KINDS, NETWORKS, TRAINED

    from policies.runs.sweep_file import load_sweep, plan_runs

    words = ["sweep", "configs/published/networks.yaml", "--jobs", "2"]
    subprocess.run([sys.executable, "-m", "robosim", *words], cwd=HERE.parent, check=False)
    taken: dict[str, dict[Path, float]] = {}  # task -> folder of policies that differ in the seed -> newest [s]
    for run in plan_runs(load_sweep(HERE.parent / words[1])):
        task, best, kind = run.arguments[2], HERE.parent / run.out / "best_policy.npz", KINDS[run.out.parent.name]
        if run.state != "finished" or not best.is_file():
            print(f"{run.out}: {run.state}, no policy")
            continue
        folder = Path("out/networks") / task / kind
        stored = HERE.parent / folder / run.out.name / "best.npz"
        stored.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(best, stored)
        if run.out.name == "seed_0":
            shutil.copy2(best, TRAINED / kind / f"{task}.npz")
        folders = taken.setdefault(task, {})
        folders[folder] = max(folders.get(folder, 0.0), best.stat().st_mtime)

    def score(task: str, end: str) -> None:
        out, names = HERE.parent / "out" / "networks" / task / end, [str(folder) for folder in taken[task]]
        scored = out / "evaluation.json"
        if not scored.is_file() or scored.stat().st_mtime < max(taken[task].values()):
            beside = ["--beside", *names[1:]] if names[1:] else []
            command(["evaluate", task, "--policy", names[0], *beside, *SCORED[end], "--episodes", str(EPISODES)], out)
        for kind in ("json", "csv"):
            shutil.copyfile(out / f"evaluation.{kind}", NETWORKS / f"{task}_{end}.{kind}")

    with ThreadPoolExecutor(2) as pool:
        list(pool.map(score, *zip(*((task, end) for end in SCORED for task in taken))))
    table = HERE.parent / "out" / "networks" / "tables"
    command(["tables", "out/networks"], table)
    rows = json.loads((table / "tables.json").read_text())
    (TRAINED / "networks.json").write_text(json.dumps(
        {"made_by": "robosim tables out/networks", **{key: rows[key] for key in ("runs", "code")}}, indent=1) + "\n")


def tables(_: Path) -> None:
    """Run the queue of the paper's tables, and store the rows of finished runs in place of earlier ones of theirs."""
    from generators.results.learning import TRAINED

    from policies.results.rows import pack_rows
    from policies.results.tables import collect_rows
    from policies.runs.sweep_file import load_sweep

    file = HERE.parent / "configs" / "published" / "tables.yaml"
    for task in load_sweep(file).tasks:
        command(["rollouts", task], HERE.parent / "out" / "tables" / "rollouts" / task)
    words = ["sweep", str(file.relative_to(HERE.parent)), "--jobs", "2"]
    subprocess.run([sys.executable, "-m", "robosim", *words], cwd=HERE.parent, check=False)
    rows = {}
    for source in (TRAINED / "tables.json", HERE.parent / "out" / "tables"):  # the second takes the place of the first
        rows |= {(row["task"], row["method"], row["seed"]): row for row in collect_rows([source])[0]}
    stored = {"made_by": "python docs/measure.py tables", **pack_rows([rows[key] for key in sorted(rows)])}
    (TRAINED / "tables.json").write_text(json.dumps(stored, indent=1) + "\n")


LONG = ("networks", "tables")
TASKS: dict[str, Callable[[Path], dict[str, Any] | None]] = {
    "rehearsal_spoon": rehearsal_spoon, **{name: partial(whole, name) for name in WHOLE}, "bench_field": bench_field,
    "gallery": gallery, "arms": arms, "foreign_arms": foreign_arms, "networks": networks,
    "tables": tables}


def main(names: list[str]) -> None:
    """Measure what is named, into a folder that is removed afterwards."""
    DATA.mkdir(parents=True, exist_ok=True)
    for name in names or [name for name in TASKS if name not in LONG]:
        out = HERE / "_build" / "measured" / name
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        measured = TASKS[name](out)
        if measured is not None:  # pictures alone
            (DATA / f"{name}.json").write_text(json.dumps(measured, indent=1) + "\n")
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:])
