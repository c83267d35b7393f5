"""One rehearsal of a set: `python -m robosim.studies.robustness.worker CONFIG OUT SEED OPTIONS CORE`.

SEED: of the model's errors, 0 for none. OPTIONS: arguments of `rehearse` as JSON. Prints the report as JSON.
"""

import contextlib
import json
import sys
from pathlib import Path

from robosim.base.input_files import read_json
from robosim.base.jobs import pin_to_core
from robosim.rehearsal.session import rehearse


def main() -> None:
    """Run the rehearsal and print its report."""
    name, out, seed, options, core = sys.argv[1:]
    pin_to_core(core)
    chosen = json.loads(options)
    if "motions" in chosen:
        chosen["motions"] = Path(chosen["motions"])
    with contextlib.redirect_stdout(sys.stderr):
        rehearse(name, Path(out), camera=None, model_errors=int(seed) or None, **chosen)
    print(json.dumps(read_json(Path(out) / "report.json")))


if __name__ == "__main__":
    main()
