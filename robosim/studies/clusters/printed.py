"""A module as a program, what it prints in a file: `python -m robosim.studies.clusters.printed FILE MODULE ARGUMENTS`.

The file has its name only after the program has ended well, so that it is whole, and that of no program that failed.
"""

import contextlib
import runpy
import sys
from pathlib import Path

from mpm.files import write


def main() -> None:
    """Run the module."""
    file, module, *arguments = sys.argv[1:]
    sys.argv = [module, *arguments]

    def run(path: Path) -> None:
        with path.open("w") as out, contextlib.redirect_stdout(out):
            runpy.run_module(module, run_name="__main__", alter_sys=True)

    write(Path(file), run)


if __name__ == "__main__":
    main()
