"""`robosim bench`: speed of the field, the coupling, kinematics, environments and rendering."""

import argparse
from typing import Any

from robosim.studies.benchmarks import FIELD_SCENES, FIELD_SIZES

EXAMPLE = """examples:
  robosim bench coupling kinematics --out out/bench
  robosim bench field --sizes 300 2880 --scenes sand fluid --out out/bench"""


def add_parser(commands: Any) -> None:
    """Add `bench` to the command line."""
    parser = commands.add_parser("bench", help="measure speed", epilog=EXAMPLE,
                                 description="Measure the run time of parts of the simulation, each in its own "
                                 "process. Exit status 0 only if every part could be measured.")
    parser.add_argument("parts", nargs="*", metavar="PART",
                        help="field alone, or any of coupling, kinematics, rendering, side_by_side (several "
                        "environments at the same time), a sub-task such as SpoonPour, arm_SpoonPour with the whole "
                        "arm, or learner (default: all but field and learner)")
    parser.add_number("--sizes", nargs="+", default=list(FIELD_SIZES), metavar="N",
                        help="field: number of grains (default: %(default)s)")
    parser.add_argument("--scenes", nargs="+", default=list(FIELD_SCENES), metavar="SCENE",
                        help=f"field: scenes, of {', '.join(FIELD_SCENES)} (default: all)")
    parser.add_number("--threads", default=1, help="field: number of CPU threads")
    parser.add_argument("--arch", choices=("cpu", "cuda"), default="cpu", help="field: processor (default: cpu)")
    parser.add_out("bench.json, or bench_field.json", is_required=False)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Measure the field, or the other parts."""
    if options.parts == ["field"]:
        from robosim.studies.benchmarks.field import bench_field

        return bench_field(options.sizes, options.scenes, options.out, options.threads, options.arch)
    from robosim.studies.benchmarks.bench import bench

    return bench(options.parts, options.out)
