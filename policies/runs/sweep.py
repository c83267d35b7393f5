"""`robosim sweep`: tasks x methods x seeds, each a run in a folder and a process of its own."""

import sys
from pathlib import Path

import mpm
from policies.learning.files import write_json
from policies.learning.preset_files import Change
from policies.runs.run_queue import run_queue
from policies.runs.slurm import submit
from policies.runs.sweep_file import load_sweep, plan_runs


def sweep(path: Path, *, jobs: int = 1, slurm: str | None = None, dry_run: bool = False,
          change: Change | None = None) -> int:
    """Run what is not finished of a sweep file; return 0, or 1 when some runs failed.

    jobs: processes at a time. slurm: partition to submit to instead. dry_run: only print the runs. change: of the
    file's table, before it is checked.

    Raises:
        mpm.InvalidValue: the file is wrong, or jobs is less than 1.
    """
    if jobs < 1:
        raise mpm.InvalidValue(f"--jobs {jobs}; accepted: 1 or more")
    file = load_sweep(path, change)
    runs = plan_runs(file)
    unfinished = [run for run in runs if run.state != "finished"]
    print(f"{len(runs)} runs, {len(runs) - len(unfinished)} finished")
    if dry_run:
        for run in unfinished:
            print(f"  {run.state:9s} robosim {' '.join(run.arguments)}")
        return 0
    if slurm is not None:
        return submit(unfinished, slurm, path)
    failed = run_queue(unfinished, jobs, len(runs))
    for run, reason in failed:
        print(f"failed: {run.out}: {reason}", file=sys.stderr)
    write_json(file.out / "sweep.json", {"runs": {str(run.out): run.state for run in runs}})
    return 1 if failed else 0
