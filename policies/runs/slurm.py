"""Runs as jobs of a SLURM cluster."""

from pathlib import Path

import mpm
from policies.runs.run_queue import start_process
from policies.runs.sweep_file import SweepRun

TIMEOUT_MIN = 24 * 60
"""Time limit of a job [min]."""


def submit(runs: list[SweepRun], partition: str, sweep_file: Path) -> int:
    """Submit runs as an array of jobs of one core each; return 0.

    Raises:
        mpm.InvalidValue: submitit is not installed.
    """
    try:
        import submitit  # pyright: ignore[reportMissingImports]  (of the extra `cluster`)
    except ImportError as error:
        raise mpm.InvalidValue("--slurm needs submitit: pip install '.[cluster]' in the checkout") from error
    executor = submitit.AutoExecutor(folder=str(sweep_file.with_suffix(".slurm")))
    executor.update_parameters(slurm_partition=partition, cpus_per_task=1, timeout_min=TIMEOUT_MIN)
    jobs = executor.map_array(run_to_end, runs)
    print(f"{len(jobs)} jobs: {', '.join(job.job_id for job in jobs)}")
    return 0


def run_to_end(run: SweepRun) -> int:
    """Run to the end in a process of its own; return its exit status."""
    return start_process(run).wait()
