"""Results of commands that pages quote: JSON files of docs/results/data, each with command, commit and machine.

`docs/measure.py` writes them. A file whose code digest is not that of the code today is marked on its page.
"""

import json
from math import isfinite
from pathlib import Path
from typing import Any

from generators.markdown import table

ROOT = Path(__file__).resolve().parents[3]
DATA = ROOT / "docs" / "results" / "data"


def stored(name: str) -> dict[str, Any]:
    """A file of measured results."""
    return json.loads((DATA / f"{name}.json").read_text())


def origin(made_by: dict[str, str]) -> str:
    """One line on where numbers come from."""
    return f"Made by `{made_by.get('command', '')}`, commit {made_by.get('commit', 'unknown')}, on " \
           f"{made_by.get('machine', 'an unknown machine')}.\n"


def outdated(name: str, module: str) -> str:
    """A note where the code that a file was measured with is not the code of today, else nothing."""
    from robosim.base.digests import code_digest

    code = stored(name).get("code")
    if code == code_digest(module):
        return ""
    return "\n:::{note}\nThe code has changed since these numbers were measured. `python docs/measure.py " \
           f"{name}` measures them again.\n:::\n"


def section(name: str, module: str) -> str:
    """The rows of a file, below where they come from."""
    measured = stored(name)
    return "\n".join([origin(measured["made_by"]), outdated(name, module), table(measured["head"], measured["rows"])])


def substitutions() -> dict[str, str]:
    """Values that pages use as `{{ name }}`."""
    from robosim.base.digests import code_digest
    from robosim.rehearsal.metrics import BOUNDS

    spoon = stored("rehearsal_spoon")
    is_old = spoon.get("code") != code_digest("robosim.commands.runs.rehearse")
    age = ", before the code changed last" if is_old else ""
    made_by = spoon["made_by"]
    bounds = {f"bound_{name}": f"{bound.low:g} to {bound.high:g}" if isfinite(bound.high) else f"from {bound.low:g}"
              for name, bound in BOUNDS.items()}
    return {**spoon["quoted"], **bounds, "spoon_origin": f"commit {made_by['commit']}, {made_by['machine']}{age}"}
