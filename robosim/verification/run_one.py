"""One run of a case, or one cell of the stability matrix, in a process of its own; prints it as JSON.

`python -m robosim.verification.run_one CASE CHOICES CORE`, or with `--cell AXIS VALUE CORE`.
"""

import json
import sys
import warnings
from dataclasses import asdict

import mpm
from robosim.reports.jobs import pin_to_core
from robosim.verification.cases import find
from robosim.verification.stability.field import judged


def main() -> None:
    """Run it."""
    *words, core = sys.argv[1:]
    pin_to_core(core)
    mpm.init()
    if words[0] == "--cell":
        print(json.dumps(asdict(judged(words[1], json.loads(words[2])))))
        return
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mpm.StrongCompression)
        print(find(words[0]).measure(**json.loads(words[1])).line())


if __name__ == "__main__":
    main()
