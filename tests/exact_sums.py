"""Comparisons to the bit, in a process of its own where sums may not be reordered."""

import os
import subprocess
import sys

CODE = "import sys, mpm; mpm.init(fast_math=False); import {0}; {0}.compared(*sys.argv[1:])"


def compare_exactly(module: str, *arguments: str) -> None:
    """Call `compared` of a test module there: the kernels of a batch and of a solver are compiled apart."""
    subprocess.run([sys.executable, "-c", CODE.format(module), *arguments], check=True,
                   env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
