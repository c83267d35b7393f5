"""One run of a case, in a process of its own: `python -m robosim.reports.one CASE CHOICES CORE`; prints the record."""

import json
import os
import sys
import warnings

import mpm
from robosim.cases import find


def main() -> None:
    """Run it."""
    name, choices, core = sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3])
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    mpm.init()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)
        print(find(name).measure(**choices).line())


if __name__ == "__main__":
    main()
