"""`robosim film`: the video of a run, drawn again from its recording."""

import argparse
import math
from pathlib import Path
from typing import Any

EXAMPLE = """examples:
  robosim film out/sugar --camera wrist --begin 3 --end 6 --out out/wrist
  robosim film out/sugar --camera orbit --height 1080 --poster 8.5 --renderer filament
  robosim film out/chain/2-SpoonTranslate.rec"""


def add_parser(commands: Any) -> None:
    """Add `film` to the command line."""
    parser = commands.add_parser("film", help="draw the video of a run again", epilog=EXAMPLE,
                                 description="Draw a video from the recording of `rehearse`, `evaluate` or `chain`, "
                                 "also of a run that was interrupted, with another camera or size.")
    parser.add_argument("what", type=Path, metavar="RUN", help="folder of a run, or a recording (.rec)")
    parser.add_argument("--camera", help="camera: auto, orbit, near, close, overview or wrist, of a sub-task "
                        "task or side (default: auto, of a sub-task task)")
    parser.add_number("--height", default=720, help="height of the pictures [pixels], 16 : 9")
    parser.add_number("--poster", nargs="?", const=True, help="also make poster.png, a still in 4K, at this time [s] "
                      "(default: when the tool empties, or is full)")
    parser.add_number("--begin", default=0.0, help="time of the first picture [s], of each sub-task of a chain")
    parser.add_number("--end", default=math.inf, help="time of the last picture [s], of each sub-task of a chain "
                      "(default: the end)")
    parser.add_argument("--renderer", choices=["auto", "filament", "classic"], default="auto", help="filament: "
                        "physically based light, of MuJoCo 4 on a Vulkan device; classic: OpenGL; auto: filament where "
                        "it can draw (default: auto)")
    parser.add_out("rehearsal.mp4 and frames.png, episode.mp4 or chain.mp4 (default: the run's, where they are "
                   "replaced)", is_required=False)
    parser.set_defaults(run=run, after_interrupt="the recording is unchanged; the same command begins again")


def run(options: argparse.Namespace) -> int:
    """Draw, and print the file's name."""
    from robosim.base.output_folder import OutputFolder
    from robosim.episode.film import FilmStyle, film_run
    from robosim.recordings.reader import find_recordings

    own = find_recordings(options.what)[0].parent
    with OutputFolder(options.out or own, is_shared=options.out is None) as folder:
        style = FilmStyle(options.camera, options.height, options.poster, options.renderer, options.begin,
                          options.end)
        print(film_run(options.what, folder.path, style))
    return 0
