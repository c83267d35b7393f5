"""One run of a case, or one cell of the stability report, in a process of its own; prints it as JSON.

`python -m robosim.verification.worker CASE CHOICES CORE`, or with `--cell AXIS VALUE CORE`; CHOICES and VALUE are JSON.
"""

import json
import sys
import warnings
from dataclasses import asdict

import mpm
from robosim.reports.jobs import pin_to_core
from robosim.verification.cases import find
from robosim.verification.stability.field import run_cell


def main() -> None:
    """Run what the command line names and print it."""
    *arguments, core = sys.argv[1:]
    pin_to_core(core)
    mpm.init()
    if arguments[0] == "--cell":
        print(json.dumps(asdict(run_cell(arguments[1], json.loads(arguments[2])))))
        return
    case, choices = arguments
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)  # some cases compress on purpose
        print(find(case).measure(**json.loads(choices)).to_json())


if __name__ == "__main__":
    main()
