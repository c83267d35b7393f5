"""The command line: `robosim rehearse` and, from other packages, the commands of the group robosim.commands."""

import argparse
import sys
from importlib.metadata import entry_points
from pathlib import Path

import mpm
from robosim.benchmarks.bench import PARTS, bench
from robosim.benchmarks.explain import explain
from robosim.benchmarks.field import SCENES, SIZES, bench_field
from robosim.commands.keys import KINDS as FILES
from robosim.commands.keys import keys
from robosim.commands.rehearse import rehearse
from robosim.config.resources import config_names
from robosim.envs import TASKS
from robosim.errors import RobosimError, RobotDiverged
from robosim.evaluation.evaluate import evaluate
from robosim.evaluation.materials import materials
from robosim.evaluation.policies import NAMES as POLICIES
from robosim.rehearsal.film import CAMERAS
from robosim.rehearsal.motion_chain import chain
from robosim.verification.cases import NAMES
from robosim.verification.stability.field import AXES, COMPARISONS
from robosim.verification.stability_matrix import stability
from robosim.verification.work_precision import report

EXAMPLE = """examples:
  robosim rehearse spoon --material sugar --camera close --out out/sugar
  robosim rehearse bottle --trajectory learned --out out/bottle"""

BENCH_EXAMPLE = """examples:
  robosim bench coupling kinematics --out out/bench
  robosim bench field --sizes 300 2880 --scenes sand fluid --out out/bench"""


def parser() -> argparse.ArgumentParser:
    """The commands and their options."""
    top = argparse.ArgumentParser(prog="robosim", description="Rehearse, evaluate and report robots in granular media.")
    commands = top.add_subparsers(dest="command", required=True)
    run = commands.add_parser("rehearse", help="carry a whole-arm motion out and report it", epilog=EXAMPLE,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("rehearsal", help=f"one of: {', '.join(config_names('rehearsals'))}; or a .yaml file of your own")
    run.add_argument("--out", type=Path, required=True, help="folder for video, pictures, report and data")
    run.add_argument("--material", help=f"one of: {', '.join(config_names('materials'))}; or a .yaml file of your own")
    run.add_argument("--trajectory", choices=["script", "learned"], help="the file's waypoints, or the learnt motions "
                     "that ship for its sub-tasks (default: the file's)")
    run.add_argument("--motions", type=Path, help="folder with a learnt motion of each sub-task as TASK.npz (default: "
                     "those that ship)")
    run.add_argument("--grasp", choices=["weld", "friction"], help="how the hand holds the tool (default: the file's)")
    run.add_argument("--camera", default="close", help=f"one of: {', '.join(CAMERAS)} (default: close)")
    run.add_argument("--no-video", action="store_true", help="leave out the film and its renderer")
    run.add_argument("--seed", type=_seed, default=0, help="of the grains' places (default: 0)")
    run.set_defaults(run=lambda a: rehearse(a.rehearsal, a.out, material=a.material, grasp=a.grasp,
                                            camera=None if a.no_video else a.camera, seed=a.seed,
                                            trajectory=a.trajectory, motions=a.motions))
    _add_chain(commands)
    _add_bench(commands)
    _add_report(commands)
    stable = commands.add_parser("stability", help="judge stiff and extreme cases",
                                 epilog="example:\n  robosim stability courant drop_height --out out/stability",
                                 formatter_class=argparse.RawDescriptionHelpFormatter)
    stable.add_argument("axes", nargs="*", metavar="AXIS", help=f"of: {', '.join(AXES)} (default: all of these); to "
                        f"compare couplings: {', '.join(COMPARISONS)}")
    stable.add_argument("--out", type=Path, required=True, help="folder for index.html and stability.json")
    stable.add_argument("--jobs", type=_positive, default=1, help="cells at a time, a core each (default: 1)")
    stable.set_defaults(run=lambda a: stability(a.axes, a.out, a.jobs))
    _add_explain(commands)
    _add_evaluate(commands)
    _add_materials(commands)
    _add_keys(commands)
    for entry in entry_points(group="robosim.commands"):
        entry.load()(commands)
    return top


def _add_chain(commands: argparse._SubParsersAction) -> None:
    """The command `chain`."""
    run = commands.add_parser("chain", help="play a rehearsal's learnt sub-tasks one after the other, without the arm",
                              epilog="example:\n  robosim chain spoon --material sugar --out out/chain",
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("rehearsal", help=f"one of: {', '.join(config_names('rehearsals'))}; or a .yaml file of your own")
    run.add_argument("--out", type=Path, required=True, help="folder for chain.json and chain.mp4")
    run.add_argument("--material", help=f"one of: {', '.join(config_names('materials'))}; or a .yaml file of your own")
    run.add_argument("--motions", type=Path, help="folder with a motion of each sub-task as TASK.npz (default: those "
                     "that ship)")
    run.add_argument("--no-video", action="store_true", help="leave out the film and its renderer")
    run.set_defaults(run=lambda a: chain(a.rehearsal, a.out, material=a.material, motions=a.motions,
                                         film=not a.no_video))


def _add_bench(commands: argparse._SubParsersAction) -> None:
    """The command `bench`."""
    run = commands.add_parser("bench", help="measure speed", epilog=BENCH_EXAMPLE,
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("what", nargs="*", metavar="PART", help=f"field alone, or any of: {', '.join(PARTS)} (default: "
                     "all but field)")
    run.add_argument("--sizes", type=int, nargs="+", default=list(SIZES), help="field: grains (default: %(default)s)")
    run.add_argument("--scenes", nargs="+", default=list(SCENES), help=f"field: of {', '.join(SCENES)} (default: all)")
    run.add_argument("--yardsticks", type=Path, help="field: folder with scripts to measure in the same run")
    run.add_argument("--threads", type=int, default=1, help="field: of the CPU (default: 1)")
    run.add_argument("--arch", choices=("cpu", "cuda"), default="cpu", help="field: where it runs (default: cpu)")
    run.add_argument("--out", type=Path, help="folder for bench.json, or bench_field.json")
    run.add_argument("--readme", type=Path, help="file with <!-- bench --> marks, between which the table goes")
    run.set_defaults(run=lambda a: bench_field(a.sizes, a.scenes, a.yardsticks, a.out, a.threads, a.arch)
                     if a.what == ["field"] else bench(a.what, a.out, a.readme))


def _add_report(commands: argparse._SubParsersAction) -> None:
    """The command `report`."""
    run = commands.add_parser("report", help="run cases with known answers: error against run time",
                              epilog="example:\n  robosim report axis_aligned vortex --quick --out out/report",
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("cases", nargs="*", metavar="CASE", help=f"of: {', '.join(NAMES)} (default: all)")
    run.add_argument("--out", type=Path, required=True, help="folder for index.html, report.json and report.jsonl (a "
                     "line a run); what is finished there is not run again")
    run.add_argument("--quick", action="store_true", help="fewer and smaller runs of every case")
    run.add_argument("--jobs", type=_positive, default=1, help="runs at a time, each pinned to a core; alone, seconds "
                     "are not disturbed (default: 1)")
    run.add_argument("--points", type=Path, help="JSON file with other codes' points on the column collapse")
    run.add_argument("--yardsticks", type=Path, help="folder with reference_layout.py, run on the spot, so that their "
                     "seconds are those of this machine")
    run.add_argument("--compare", type=Path, help="report.json of another run: what got better, what worse")
    run.set_defaults(run=lambda a: report(a.cases, a.out, quick=a.quick, jobs=a.jobs, points=a.points,
                                          yardsticks=a.yardsticks, compare=a.compare))


def _add_explain(commands: argparse._SubParsersAction) -> None:
    """The command `explain`."""
    run = commands.add_parser("explain", help="what a scene is made of, and its cheapest setting",
                              epilog="example:\n  robosim explain SpoonPour --tolerance 0.02 --out out/explain",
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("scene", help=f"one of: {', '.join([*TASKS, *config_names('rehearsals')])}; or the .yaml file "
                     "of a task or a rehearsal")
    run.add_argument("--tolerance", type=float, help="run the scene coarse to fine as well, and find the cheapest "
                     "setting whose readings lie within this of the scene's own: shares by their difference, masses "
                     "and forces relative")
    run.add_argument("--apply", action="store_true", help="write the scene's file with that setting into --out")
    run.add_argument("--jobs", type=_positive, default=1, help="settings at a time, a core each (default: 1)")
    run.add_argument("--out", type=Path, help="folder for index.html and explain.json; what is there is not run again")
    run.set_defaults(run=lambda a: explain(a.scene, tolerance=a.tolerance, out=a.out, apply=a.apply, jobs=a.jobs))


def _add_evaluate(commands: argparse._SubParsersAction) -> None:
    """The command `evaluate`."""
    run = commands.add_parser("evaluate", help="score a policy on a sub-task",
                              epilog="example:\n  robosim evaluate SpoonPour --policy scripted --out out/pour",
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("task", help=f"one of: {', '.join(TASKS)}; or a task's .yaml file")
    run.add_argument("--policy", default="scripted", help=f"one of: {', '.join(POLICIES)}; or a .npz file with an "
                     "array `actions` (default: scripted)")
    run.add_argument("--episodes", type=_positive, help="with seeds from --seed on (default: 5; 1 with "
                     "--nominal)")
    run.add_argument("--seed", type=_seed, default=0, help="of the first episode (default: 0)")
    run.add_argument("--material", help=f"one of: {', '.join(config_names('materials'))}; or a .yaml file of your own")
    run.add_argument("--nominal", action="store_true", help="start at the task's own place, not within its ranges")
    run.add_argument("--arm", action="store_true", help="let the whole arm carry the tool")
    run.add_argument("--grasp", choices=["weld", "friction"], default="weld", help="how its hand holds it")
    run.add_argument("--out", type=Path, help="folder for evaluation.json and episode.mp4 (the first episode)")
    run.add_argument("--no-video", action="store_true", help="leave out the film and its renderer")
    run.set_defaults(run=lambda a: evaluate(
        a.task, a.policy, a.out, episodes=a.episodes, seed=a.seed, film=not a.no_video, nominal=a.nominal,
        material=a.material, arm=a.arm, grasp=a.grasp))


def _add_keys(commands: argparse._SubParsersAction) -> None:
    """The command `keys`."""
    run = commands.add_parser("keys", help="what may stand in a file of your own",
                              epilog="examples:\n  robosim keys rehearsal\n  robosim keys task --schema > task.json",
                              formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("kind", help=f"one of: {', '.join(FILES)}")
    run.add_argument("--schema", action="store_true", help="as JSON Schema, which editors complete and check by")
    run.set_defaults(run=lambda a: keys(a.kind, schema=a.schema))


def _add_materials(commands: argparse._SubParsersAction) -> None:
    """The command `materials`."""
    run = commands.add_parser("materials", help="score one motion among thirteen materials",
                              epilog="example:\n  robosim materials SpoonTranslate ShovelMove --jobs 2 --out "
                              "out/materials", formatter_class=argparse.RawDescriptionHelpFormatter)
    run.add_argument("tasks", nargs="*", metavar="TASK",
                     help=f"of: {', '.join(TASKS)}; or a task's .yaml file (default: all that ship)")
    run.add_argument("--policy", default="learned", help=f"one of: {', '.join(POLICIES)}; or a .npz file with an array "
                     "`actions` (default: learned, the motions that ship)")
    run.add_argument("--jobs", type=_positive, default=1, help="tasks at a time, a core each (default: 1)")
    run.add_argument("--out", type=Path, required=True, help="folder for materials.json, .csv and .png; what is there "
                     "is not played again")
    run.set_defaults(run=lambda a: materials(a.tasks or list(TASKS), a.out, name=a.policy, jobs=a.jobs))


def _positive(text: str) -> int:
    """A whole number from 1 on."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 on")
    return int(text)


def _seed(text: str) -> int:
    """A whole number from 0 on."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 on")
    return int(text)


def main(arguments: list[str] | None = None) -> int:
    """Run a command; 0 when all is well, 1 for a run that failed, 2 for wrong input, 130 for Ctrl-C."""
    options = parser().parse_args(arguments)
    try:
        return options.run(options)
    except (RobosimError, mpm.MpmError) as error:
        print(f"robosim {options.command}: {error}", file=sys.stderr)
        return 1 if isinstance(error, (mpm.SimulationDiverged, mpm.GradientDiverged, RobotDiverged)) else 2
    except OSError as error:  # a full disk, a folder taken away: what was renamed into place is whole
        print(f"robosim {options.command}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"robosim {options.command}: stopped by Ctrl-C; what was finished is in --out", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
