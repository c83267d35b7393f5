"""`robosim rehearse`: a whole-arm rehearsal with report, film and trajectory."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import UnknownName
from robosim.base.resources import config_names
from robosim.commands.arguments import one_of, refuse
from robosim.episode import AUTO, FRAMING
from robosim.rehearsal import CAMERAS

EXAMPLE = """examples:
  robosim rehearse spoon --material sugar --camera close --out out/sugar
  robosim rehearse spoon --set field.cell=0.005 --set tool_wall=0.003 --out out/coarse
  robosim rehearse bottle --trajectory recorded --out out/bottle
  robosim rehearse shovel --policy out/networks/ShovelMove/dagger/seed_0 --out out/push
  robosim rehearse spoon --perturb 8 --jobs 2 --out out/robust
  robosim rehearse spoon --recorded real.mcap --out out/real
  robosim rehearse dose.yaml --recorded datasets/dose --episode 3 --unplanned --out out/replay"""


def add_parser(commands: Any) -> None:
    """Add `rehearse` to the command line."""
    parser = commands.add_parser("rehearse", help="simulate a whole-arm motion and report on it", epilog=EXAMPLE,
                                 description="Plan a rehearsal's motion, simulate arm and grains, and write report, "
                                 "video and joint trajectory. Exit status 0 only if every result is in its accepted "
                                 "range.")
    parser.add_argument("rehearsal", help=one_of(config_names("rehearsals")))
    parser.add_out("video, plots, report and data")
    parser.add_material("the rehearsal's")
    parser.add_argument("--trajectory", metavar="{script,recorded}", help="follow the file's waypoints, or the "
                        "recorded motions of its sub-tasks (default: what the file says)")
    parser.add_argument("--motions", type=Path, help="folder with a recorded motion of each sub-task as TASK.npz "
                        "(default: the bundled motions)")
    parser.add_argument("--policy", type=Path, metavar="RUN", help="let learned policies of its sub-tasks move the "
                        "arm: a folder with TASK.npz of each; of a single one also the file, or the folder of its "
                        "training run")
    parser.add_argument("--recorded", type=Path, metavar="FILE", help="play what the real arm recorded of the motion, "
                        "and compare its joint angles with the plan, its wrist wrench with the simulated one: a .csv "
                        "file with columns as in trajectory.csv, a bag of ROS with JointState and WrenchStamped, or "
                        "the folder of a LeRobot dataset of version 3")
    parser.add_number("--episode", default=0, help="with --recorded: episode of a LeRobot dataset")
    parser.add_argument("--unplanned", action="store_true", help="with --recorded: a motion of its own, such as of "
                        "another robot's program, played from its first sample to its last")
    parser.add_argument("--grasp", choices=["weld", "friction"], help="tool welded to the hand, or held by the fingers "
                        "alone (default: what the file says)")
    parser.add_argument("--camera", default=AUTO, help=f"camera of the video: {one_of((*FRAMING, *CAMERAS), '')}")
    parser.add_number("--frame-rate", default=20, help="frames of recording and video per second")
    parser.add_number("--height", default=720, help="height of the video's pictures [pixels], 16 : 9")
    parser.add_number("--poster", nargs="?", const=True, help="also make poster.png, a still in 4K, at this time [s] "
                      "(default: when the tool empties, or is full)")
    parser.add_argument("--no-video", action="store_true", help="make no video")
    parser.add_argument("--force-export", action="store_true", help="write the motion for the real robot also where a "
                        "bound was missed, as joint_trajectory_MISSED_BOUNDS.yaml")
    parser.add_number("--seed", default=0, help="random seed of the grains' initial positions")
    parser.add_number("--model-errors", metavar="SEED", help="let the robot differ from the model that plans and "
                      "controls it: payload, joint friction, latency, place of the tool in the hand, gains")
    parser.add_number("--perturb", metavar="N", help="run with the exact model and N times with such errors, without "
                      "videos, and report the worst of every figure")
    parser.add_number("--jobs", default=1, help="with --perturb: runs at the same time")
    parser.add_launcher()
    parser.add_settings("rehearsal's file", "field.cell=0.004 or waypoints.2.speed=0.1")
    parser.add_threads()
    parser.set_defaults(run=run, after_interrupt="--out has what was simulated so far, of which `robosim "
                        "film` draws a video; the same command begins again")


def run(options: argparse.Namespace) -> int:
    """Check the names, then rehearse."""
    if options.camera not in (*FRAMING, *CAMERAS):
        raise UnknownName("camera", options.camera, (*FRAMING, *CAMERAS))
    if options.trajectory not in (None, "script", "recorded"):
        raise UnknownName("trajectory", options.trajectory, ("script", "recorded"))
    if options.policy is not None:
        refuse(options, "with --policy; accepted: without", trajectory=None, recorded=None, perturb=None)
        options.trajectory = "recorded"  # its sub-tasks, at their places
    with options.settings.changed("rehearsals", options.rehearsal, options.out) as rehearsal:
        if options.perturb is not None:
            return run_perturbed(options, rehearsal)
        refuse(options, "without --perturb; accepted: with it", launch="local", launch_file=None, jobs=1)
        from robosim.episode.film import FilmStyle
        from robosim.rehearsal.session import RunOptions, rehearse

        film = FilmStyle(options.camera, options.height, options.poster)
        driver = None
        if options.policy is not None:
            from robosim.rehearsal.session import check_rehearsal
            from robosim.studies.evaluation.policy_driver import PolicyDriver

            driver = PolicyDriver(options.policy, check_rehearsal(rehearsal, trajectory="recorded"))
        given = RunOptions(None if options.no_video else film, options.frame_rate, options.seed, options.recorded,
                           options.episode, options.unplanned, options.model_errors, driver)
        return rehearse(rehearsal, options.out, given, force_export=options.force_export, material=options.material,
                        grasp=options.grasp, trajectory=options.trajectory, motions=options.motions)


def run_perturbed(options: argparse.Namespace, rehearsal: str) -> int:
    """Run the rehearsal with the exact model and with errors of it."""
    refuse(options, "with --perturb; accepted: without", recorded=None, episode=0, unplanned=False, model_errors=None,
           poster=None, camera=AUTO, frame_rate=20, height=720, field_threads=1)
    from robosim.studies.robustness.perturbed_runs import perturb

    chosen = {name: getattr(options, name) for name in ("material", "grasp", "trajectory", "seed")}
    chosen["motions"] = options.motions and str(options.motions.resolve())
    return perturb(rehearsal, options.out, options.perturb, jobs=options.jobs, launcher=options.find_launcher(options),
                   options={name: value for name, value in chosen.items() if value is not None})
