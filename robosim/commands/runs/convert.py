"""`robosim convert`: a run in the formats of other tools."""

import argparse
from pathlib import Path
from typing import Any

from robosim.base.errors import ConfigError
from robosim.conversion import FORMATS

EXAMPLE = """examples:
  robosim convert out/sugar --to mcap --out out/sugar_bag
  robosim convert out/sugar --to glb --time 4.2 --out out/pour.glb"""


def add_parser(commands: Any) -> None:
    """Add `convert` to the command line."""
    parser = commands.add_parser("convert", help="write a run for other tools", epilog=EXAMPLE,
                                 description="Write the results of a run as a bag of ROS 2 (joint states, wrenches, "
                                 "poses, grains, pictures and the planned motion; no ROS is needed), or one of its "
                                 "frames as glTF.")
    parser.add_argument("folder", type=Path, metavar="RUN", help="folder of a run of `robosim rehearse`")
    parser.add_argument("--to", choices=list(FORMATS), required=True,
                        help="; ".join(f"{name}: {text}" for name, text in FORMATS.items()))
    parser.add_number("--time", default=0.0, help="glb: time of the frame [s] (default: 0)")
    parser.add_out("the bag, or the .glb file")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Convert, and print what was written."""
    if options.to == "glb":
        if options.out.suffix != ".glb":
            raise ConfigError(f"--out {options.out}: accepted with --to glb: a file that ends in .glb")
        from robosim.base.output_folder import OutputFolder
        from robosim.conversion.gltf import write_frame
        from robosim.recordings.reader import Recording, find_recordings

        with Recording(find_recordings(options.folder)[0]) as recording, OutputFolder(options.out.parent, True):
            time = write_frame(recording, options.time, options.out)
        print(f"{options.out}: the frame at {time:.3f} s")
        return 0
    try:
        from robosim.conversion.bag import write_bag
    except ImportError as error:
        raise ConfigError(f"--to {options.to} needs {error.name}: pip install '.[ros]' in the checkout") from None

    for topic, count in write_bag(options.folder, options.out, options.to).items():
        print(f"{topic:20s} {count} messages")
    return 0
