"""Pictures of runs: stills, loops, sheets of frames, and pages."""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from generators.results.measured import ROOT

from measuring.running import command

IMAGES = ROOT / "docs" / "images"
POSTERS = {"spoon": 8.85, "scoop": 9.4, "bottle": 3.9, "shovel": 2.8}
"""Rehearsal -> time [s] of its still: grains fall, or move."""
LOOPS = {
    "spoon": (["rehearse", "spoon", "--no-video"], "near", 7.6),
    "scoop": (["rehearse", "scoop", "--no-video"], "near", 2.4),
    "bottle": (["rehearse", "bottle", "--no-video"], "near", 2.6),
    "shovel": (["rehearse", "shovel", "--no-video"], "near", 1.6),
    "dose_spoon": (["rehearse", "dose_spoon", "--no-video"], "near", 5.0),
    "ur5e": (["rehearse", "spoon", "--no-video", "--set", "robot=ur5e", "--material", "sugar"], "auto", 2.6),
    "push": (["evaluate", "ShovelMove", "--policy", "network", "--episodes", "1", "--no-video"], "near", 0.0),
    **{task: (["evaluate", task, "--policy", "pi", "--episodes", "1", "--no-video"], "near", 3.0)
       for task in ("DoseSpoon", "DoseScoop", "DoseBottle")}}
"""Loop of the gallery -> command whose run it shows, camera, and time [s] at which it begins."""
LOOP_SECONDS, LOOP_RATE = 3.0, 12
DRAW = os.environ.get("DRAW") or sys.executable
"""Interpreter with MuJoCo 4, which draws what others have recorded."""


def pictures(out: Path) -> None:
    """The sheet of nine and the page of curves; small enough for a repository."""
    from PIL import Image

    IMAGES.mkdir(exist_ok=True)
    sheet = Image.open(out / "frames.png").convert("RGB")
    sheet.resize((1440, 810)).save(IMAGES / "spoon_sheet.jpg", quality=80, optimize=True)
    if shutil.which("chromium") is None:
        print("spoon_report.png is left as it is: it needs Chromium, which is not installed", file=sys.stderr)
        return
    picture_of_page(out / "index.html", out / "page.png")
    curves = Image.open(out / "page.png").convert("RGB").quantize(64)
    curves.save(IMAGES / "spoon_report.png", optimize=True)


def draw(run: Path, out: Path, camera: str, begin: float, end: float, *more: str) -> None:
    """Draw a part of a film by Filament."""
    words = ["film", str(run), "--renderer", "filament", "--camera", camera, "--height", "540", "--begin", str(begin),
             "--end", str(end), *more]
    subprocess.run([DRAW, "-m", "robosim", *words, "--out", str(out)], cwd=ROOT, check=True)


def check_interpreter() -> None:
    """End the program where DRAW cannot draw by Filament."""
    asked = subprocess.run([DRAW, "-c", "import mujoco; print(mujoco.__version__)"], capture_output=True, text=True)
    if asked.returncode or asked.stdout.startswith("3."):
        has = f"has MuJoCo {asked.stdout.strip()}" if asked.stdout else f"has no MuJoCo: {asked.stderr[-300:]}"
        sys.exit(f"gallery: {DRAW} {has}; Filament needs MuJoCo 4. Name an interpreter that has it: DRAW=PYTHON python "
                 "docs/measure.py gallery (docs/guides/video.md)")


def still(run: Path, name: str) -> None:
    """The still of a rehearsal."""
    from PIL import Image

    moment, out = POSTERS[name], run / "still"
    draw(run, out, "auto" if name == "spoon" else "near", moment, moment + 0.1, "--poster", str(moment))
    poster = Image.open(out / "poster.png").convert("RGB")
    poster.resize((1280, 720), Image.Resampling.LANCZOS).save(IMAGES / f"{name}.jpg", quality=84, optimize=True)


def gallery(out: Path) -> None:
    """Stills of the rehearsals, and the loops."""
    for name, (words, camera, begin) in LOOPS.items():
        run = out / name
        command(words, run)
        draw(run, run / "loop", camera, begin, begin + LOOP_SECONDS)
        loop(next((run / "loop").glob("*.mp4")), IMAGES / f"{name}.webp")
        if name in POSTERS:
            still(run, name)


def loop(film: Path, out: Path) -> None:
    """Write a film as a picture that moves."""
    from PIL import Image

    from robosim.rendering.video import read_frames

    frames = [Image.fromarray(frame).resize((480, 270), Image.Resampling.LANCZOS)
              for frame in read_frames(film, round(LOOP_SECONDS * LOOP_RATE))]
    frames[0].save(out, save_all=True, append_images=frames[1:], duration=round(1000 / LOOP_RATE), loop=0, quality=60,
                   method=6)


def picture_of_arms(arms: Mapping[str, str]) -> None:
    """Draw every arm with its hand while it digs, and without while it pours, under its name."""
    import mujoco
    import numpy as np
    from PIL import Image, ImageDraw

    from robosim.config.rehearsal import load_rehearsal
    from robosim.planning.plan import plan_motion
    from robosim.rendering.renderer import SceneRenderer
    from robosim.scene.build import compile_rehearsal

    rows = []
    for gripper, waypoint in ((None, "dig"), ("none", "tilt")):
        rows.append([])
        for arm in arms:
            plan = plan_motion(load_rehearsal("spoon", {"robot": arm, "gripper": gripper}))
            scene = compile_rehearsal(plan.config)
            data, renderer = mujoco.MjData(scene.model), SceneRenderer(scene.model, 0, 440, 480)
            data.qpos[scene.arm_qpos] = plan.motion.state(plan.path.times[waypoint]).q
            mujoco.mj_forward(scene.model, data)
            rows[-1].append(renderer.draw(data, None, "overview"))
            renderer.close()
    drawn = Image.fromarray(np.concatenate([np.concatenate(row, 1) for row in rows], 0))
    picture = drawn.resize((1440, 528), Image.Resampling.LANCZOS)
    width, pen = picture.width / len(arms), ImageDraw.Draw(picture)
    for k, name in enumerate(arms.values()):
        pen.text(((k + 0.5) * width, 12), name, fill="#202428", anchor="ma", font_size=18)
    picture.save(IMAGES / "arms.jpg", quality=84, optimize=True)


def picture_of_page(page: Path, out: Path) -> None:
    """Draw the curves of a run's page in Chromium."""
    script = ("<script>for (const part of document.querySelectorAll('main > *')) "
              "if (!part.querySelector('.plotly-graph-div')) part.remove(); document.querySelector('header').remove(); "
              "window.dispatchEvent(new Event('resize'))</script></body>")
    cut = out.with_suffix(".html")
    cut.write_text(page.read_text().replace("</body>", script))
    subprocess.run(["chromium", "--headless", "--no-sandbox", "--hide-scrollbars", "--window-size=1180,1780",
                    "--virtual-time-budget=8000", f"--screenshot={out}", cut.resolve().as_uri()], check=True)
