"""Cases by name, and the processes that run them: those of a group share a backend."""

import contextlib
import fnmatch
import gc
import json
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from keep import Keep

GROUPS: dict[str, dict[str, Any]] = {
    "f32": {"precision": "f32"},
    "f64": {"precision": "f64"},
    "ieee": {"precision": "f64", "fast_math": False},
    "threads": {"precision": "f64", "threads": 2},
}
"""Name of a group -> arguments of `mpm.init`."""
BOTH = ("f32", "f64")
MARK = "\x1estate "
"""Begins a line of the process of a group, which its parent reads; libraries print others."""


class Case(NamedTuple):
    """A simulation that yields arrays."""

    name: str
    """Group and name."""
    run: Callable[[Keep], None]


def case_of(groups: tuple[str, ...], name: str, run: Callable[..., None], *args: Any, **options: Any) -> list[Case]:
    """Return a case for each of some groups; arguments go to `run`, after what keeps its states."""
    return [Case(f"{group}/{name}", lambda keep: run(keep, *args, **options)) for group in groups]


def all_cases(full: bool = True) -> Iterator[Case]:
    """Yield the usual cases, or with `full` all, those of a group together."""
    import environments
    import fields
    import plans
    import rollouts
    import scenes

    modules = (fields, scenes, rollouts, environments, plans)
    cases = [case for module in modules for case in [*module.CASES, *(module.MORE if full else [])]]
    for group in GROUPS:
        yield from (case for case in cases if case.name.startswith(f"{group}/"))


def list_cases(patterns: list[str], full: bool) -> list[str]:
    """Return the names of the usual cases, or with patterns or `full` of all, that one of the patterns fits."""
    return [case.name for case in all_cases(full or bool(patterns))
            if any(fnmatch.fnmatchcase(case.name, one) for one in patterns or ["*"])]


def run_group(group: str, *names: str) -> int:
    """Run cases of a group in this process; each prints a line of JSON when it begins, and another when it ends."""
    import mpm

    warnings.simplefilter("ignore")
    mpm.init(**GROUPS[group])
    cases = {case.name: case for case in all_cases()}
    for name in names:
        _tell({"began": name})
        _tell({"ended": name} | _run(cases[name]))
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


def _tell(message: dict[str, Any]) -> None:
    print(MARK + json.dumps(message), flush=True)
