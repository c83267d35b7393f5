"""Run the commands whose results the pages quote, and store these in docs/results/data: `python docs/measure.py NAME`.

Names: rehearsal_spoon (and the pictures of its page), arms (three rehearsals with every arm, with its hand and
without), foreign_arms (the spoon with arms of other packages, which docs/developer/testing.md says how to get),
stability, bench, bench_field, gallery (stills of the rehearsals, and loops), report (all verification cases), dosing
(our entries of the benchmark), networks (the bundled policies and their scores) and tables (the paper's): the last four
take hours and days, and continue where they were interrupted. Without a name: all but these four. The gallery is drawn
by Filament: DRAW in the environment names an interpreter with MuJoCo 4 (docs/guides/video.md).
"""

import argparse
import json
import re
import shutil
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE), str(HERE.parent / "tests")]

from foreign_arms import ARMS as FOREIGN  # noqa: E402
from foreign_arms import find_arm  # noqa: E402
from generators.results.measured import DATA  # noqa: E402
from measuring.dosing import dosing  # noqa: E402
from measuring.learning import networks, tables  # noqa: E402
from measuring.pictures import check_interpreter, gallery, picture_of_arms, pictures  # noqa: E402
from measuring.running import command, made_by  # noqa: E402
from measuring.verification import report  # noqa: E402

from robosim.base.digests import code_digest  # noqa: E402
from robosim.studies.verification.stability import AXES, COMPARISONS, SLEEPING_AXES  # noqa: E402

SIZES = ["300", "2880", "50000"]


def rehearsal_spoon(out: Path) -> dict[str, Any]:
    """The figures of the report, the sheet of frames and the page."""
    words = ["rehearse", "spoon"]
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
    picture_of_arms(ARMS)
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


WHOLE = {"stability": [*AXES, *COMPARISONS, *SLEEPING_AXES],
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


LONG = ("report", "dosing", "networks", "tables")
TASKS: dict[str, Callable[[Path], dict[str, Any] | None]] = {
    "rehearsal_spoon": rehearsal_spoon, **{name: partial(whole, name) for name in WHOLE}, "bench_field": bench_field,
    "arms": arms, "foreign_arms": foreign_arms, "gallery": gallery, "dosing": dosing,
    "report": report, "networks": networks, "tables": tables}


def main(words: list[str]) -> None:
    """Measure what is named, into a folder that is removed afterwards."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                     epilog="example:\n  python docs/measure.py rehearsal_spoon bench")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(TASKS)}")
    names = parser.parse_args(words).names
    if unknown := [name for name in names if name not in TASKS]:
        parser.error(f"unknown: {', '.join(unknown)}; accepted: {', '.join(TASKS)}")
    DATA.mkdir(parents=True, exist_ok=True)
    chosen = names or [name for name in TASKS if name not in LONG]
    if "gallery" in chosen:
        check_interpreter()
    for name in chosen:
        out = HERE / "_build" / "measured" / name
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        measured = TASKS[name](out)
        if measured is not None:  # pictures alone
            (DATA / f"{name}.json").write_text(json.dumps(measured, indent=1) + "\n")
        print(name)


if __name__ == "__main__":
    main(sys.argv[1:])
