"""Record of states: proves that a change of the code leaves the physics as it was, bit for bit.

A script, because it compares two versions of the code. Each case simulates a little and yields named arrays; the
record has a hash of the bytes of each, its sum and its largest magnitude. Keep one copy, and give it the checkouts.

    python tests/states old.json --tree path/of/a/checkout     # default: the checkout that the script is in
    python tests/states new.json --tree path/of/another
    python tests/states --compare old.json new.json            # prints what differs, and returns 1 if anything does
    python tests/states --list                                 # names of the usual cases; with --full of all
    python tests/states new.json --full --only 'f32/env/*'     # adds what the usual ones leave out; cases by name

Results are written after each case. A run started again adds the cases that its file lacks, and refuses a file of
another version; --again repeats cases. A case that fails is recorded as its error. Cases of a group share a process:
f32 and f64 on one thread, ieee (f64 in which the compiler keeps the order of operations), threads (two).
A difference in f32 and f64 that is not in ieee comes from the order of operations alone. Bits also depend on processor
and libraries ("machine", "versions"): compare records of one machine. Caches of settled starts and of distances are new
in each run; compiled kernels are kept in TMPDIR/states_kernels, as Taichi's own cache of 100 MB forgets them.

internals.py has all that is not public."""

import argparse
import sys
from pathlib import Path

from compare import compare
from groups import list_cases, run_cases
from record import make_record

ROOT = Path(__file__).resolve().parents[2]


def main() -> int:
    parser = argparse.ArgumentParser("python tests/states", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("out", type=Path, nargs="?", help="file of the record")
    parser.add_argument("--tree", type=Path, default=ROOT, help="checkout whose code is run")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="names of cases, with wildcards")
    parser.add_argument("--full", action="store_true", help="all cases, not only the usual ones")
    parser.add_argument("--again", action="store_true", help="run cases that the file has already")
    parser.add_argument("--list", action="store_true", help="print the names of all cases")
    parser.add_argument("--compare", type=Path, nargs=2, metavar=("A", "B"), help="print what differs in two records")
    parser.add_argument("--run", nargs="+", help=argparse.SUPPRESS)  # how the script starts its own processes
    given = parser.parse_args()
    if given.run:
        return run_cases(given.out, given.run)
    if given.compare:
        return compare(*given.compare, given.only or ["*"])
    if given.list:
        print("\n".join(list_cases(given.only, given.full)))
        return 0
    if given.out is None:
        parser.error("no file is given")
    choice = [*(["--full"] if given.full else []), *(["--only", *given.only] if given.only else [])]
    return make_record(given.out.resolve(), given.tree.resolve(), choice, given.again)


if __name__ == "__main__":
    sys.exit(main())
