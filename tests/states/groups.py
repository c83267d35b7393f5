"""Cases by name, and the run of those of a group, which share a process and a backend."""

import contextlib
import fnmatch
import gc
import json
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from keep import Keep

GROUPS: dict[str, dict[str, Any]] = {
    "f32": {"precision": "f32"},
    "f64": {"precision": "f64"},
    "ieee": {"precision": "f64", "fast_math": False},
    "threads": {"precision": "f64", "threads": 2},
}
"""Name of a group -> arguments of `mpm.init`."""
BOTH = "f32 f64"


class Case(NamedTuple):
    """A simulation that yields arrays."""

    name: str
    """Group and name."""
    run: Callable[[Keep], None]
    is_usual: bool
    """Whether it is run without --full."""


def case_of(name: str, run: Callable[..., None], *args: Any, usual: str = "", more: str = "",
            **options: Any) -> list[Case]:
    """Return a case in each of the groups that are run usually, and of those that --full adds.

    Arguments go to `run`, after what keeps its states."""
    return [Case(f"{group}/{name}", lambda keep: run(keep, *args, **options), is_usual)
            for groups, is_usual in ((usual, True), (more, False)) for group in groups.split()]


def all_cases() -> list[Case]:
    """Return all cases, those of a group together."""
    import environments
    import fields
    import plans
    import scenes

    cases = [case for module in (fields, scenes, environments, plans) for some in module.CASES for case in some]
    return [case for group in GROUPS for case in cases if case.name.startswith(f"{group}/")]


def list_cases(patterns: list[str], full: bool) -> list[str]:
    """Return the names of the usual cases, or with patterns or `full` of all, that one of the patterns fits."""
    return [case.name for case in all_cases() if (case.is_usual or full or patterns)
            and any(fnmatch.fnmatchcase(case.name, one) for one in patterns or ["*"])]


def run_cases(out: Path, names: list[str]) -> int:
    """Run cases of one group in this process; each is added to the record as soon as it ends."""
    import mpm

    warnings.simplefilter("ignore")
    mpm.init(**GROUPS[names[0].partition("/")[0]])
    cases = {case.name: case for case in all_cases()}
    for name in names:
        result = _run(cases[name])
        record = json.loads(out.read_text())
        record["cases"][name] = result
        write(out, record)
        print(f"{result['seconds']:7.1f} s, {result['cpu_seconds']:.1f} s of processor: {name} "
              f"{result.get('error', '')}", flush=True)
        gc.collect()  # fields of solvers that a case left open
    return 0


def _run(case: Case) -> dict[str, Any]:
    """Run a case; return its values or its error, and the seconds that it took."""
    begin, busy, keep, outcome = time.perf_counter(), time.process_time(), Keep(), {}
    try:
        with contextlib.redirect_stdout(sys.stderr):
            case.run(keep)
    except Exception as error:
        outcome = {"error": f"{type(error).__name__}: {error}"}
        traceback.print_exc()
    return {"values": keep.values, **outcome, "seconds": round(time.perf_counter() - begin, 2),
            "cpu_seconds": round(time.process_time() - busy, 2)}


def write(out: Path, record: dict[str, Any]) -> None:
    """Write the record in one go, so that an interruption leaves a complete one."""
    part = out.with_suffix(".part")
    part.write_text(json.dumps(record, indent=0))
    part.replace(out)
