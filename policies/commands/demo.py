"""`robosim demo`: demonstrations by descent through the field, or by CMA-ES."""

import argparse
from typing import Any

from policies.commands.arguments import add_action_repeat, add_task, take_options
from policies.demonstrations import METHODS
from policies.learning.names import check_task
from policies.learning.options import RATE, SearchOptions
from robosim.commands.arguments import refuse

EXAMPLE = """examples:
  robosim demo SpoonTranslate --n 2 --jobs 2 --out out/demo
  robosim demo SpoonScoop --from script --until 0.75 --n 1 --out out/scoop
  robosim demo ShovelMove --expert 200 --randomize hard --out out/expert
  robosim demo SpoonPour --method cmaes --material salt --n 1 --out out/evolved"""


def add_parser(commands: Any) -> None:
    """Add `demo` to the command line."""
    parser = commands.add_parser("demo", help="make demonstrations by gradient descent or CMA-ES", epilog=EXAMPLE,
                                 description="Optimise motions of a sub-task by gradient descent through the "
                                 "differentiable simulation, or by CMA-ES, and write them as demonstrations.")
    add_task(parser)
    parser.add_out("demonstrations, the table and index.html; an interrupted run continues with the same command")
    parser.add_number("--n", default=10, help="number of demonstrations, from different starts")
    parser.add_number("--expert", metavar="N", help="no search: N episodes of the task's script, displaced with "
                      "its target, with seeds from --seed on")
    parser.add_argument("--randomize", metavar="wide|hard|FILE", help="with --expert: what they draw (default: the "
                        "task's own random starts)")
    parser.add_number("--jobs", default=1, help="number of demonstrations at the same time")
    parser.add_argument("--method", choices=METHODS, default="descent", help="gradient descent, or CMA-ES on a spline "
                        "of the same motion, without gradients")
    parser.add_material("glycerol; clay for scooping and for the shovel", "material of the optimisation")
    parser.add_number("--iterations", default=150, help="largest number of iterations for each demonstration")
    parser.add_number("--rate", default=RATE, help="largest change of an action (range -1 to 1) in an iteration")
    add_action_repeat(parser)
    parser.add_argument("--from", dest="start", help="initial motion: a .npz file with actions, or `script`, the "
                        "task's scripted motion, for a tool that must touch its material first (default: at rest)")
    parser.add_number("--until", help="with --from script: keep the scripted motion fixed up to this time [s]; after "
                      "it the tool is initially at rest (default: start with the whole script, keep nothing fixed)")
    parser.add_number("--limit", help="clip each entry of the state's adjoint to this in every substep; sand may need "
                      "it (default: no clipping)")
    parser.add_number("--seed", default=0, help="random seed of the first start, as in the environment's reset")
    parser.add_argument("--nominal", action="store_true", help="start the first demonstration at the task's nominal "
                        "pose, as training does by default; the others start at random poses")
    parser.add_argument("--arm", action="store_true", help="report joint speeds and angles that the motion needs, and "
                        "replay it with the arm")
    parser.add_number("--arm-weight", default=0.0, help="weight of a penalty on joint speeds and angles beyond the "
                      "arm's limits (default: 0)")
    parser.add_argument("--no-video", action="store_true", help="make no videos")
    parser.add_settings("task's file", "grains.count=100")
    parser.set_defaults(run=run, after_interrupt="finished iterations are kept; the same command continues")


def run(options: argparse.Namespace) -> int:
    """Check the names, then make the demonstrations."""
    check_task(options.task)
    o = options
    if o.expert is None:
        refuse(o, "without --expert; accepted: with it", randomize=None)
    else:
        refuse(o, "with --expert; accepted: without", n=10, jobs=1, method="descent", iterations=150, rate=RATE,
               start=None, until=None, limit=None, nominal=False, arm=False, arm_weight=0.0, no_video=False)
    with o.settings.changed("tasks", o.task, o.out) as task:
        if o.expert is not None:
            from policies.demonstrations.demo import record_expert

            return record_expert(task, o.out, o.expert, seed=o.seed, randomize=o.randomize, material=o.material,
                                 action_repeat=o.action_repeat)
        from policies.demonstrations.demo import demonstrate
        from policies.results.pages import write_demonstration_page

        return demonstrate(task, o.out, take_options(SearchOptions, o), n=o.n, jobs=o.jobs, arm=o.arm,
                           film=not o.no_video, page=write_demonstration_page)
