"""Commands whose results are stored."""

import subprocess
import sys
import time
from pathlib import Path

from generators.results.measured import ROOT

from robosim.base.provenance import provenance


def command(words: list[str], out: Path) -> float:
    """Run `robosim WORDS --out OUT`; the seconds that it took."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-m", "robosim", *words, "--out", str(out)], cwd=ROOT, check=False)
    return time.perf_counter() - begin


def made_by(words: list[str]) -> dict[str, str]:
    """Command, commit and machine."""
    return {**provenance(), "command": " ".join(["robosim", *words])}
