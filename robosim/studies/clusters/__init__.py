"""Many runs of `robosim` on other machines: arrays of SLURM jobs.

Imports: base, config."""

LAUNCHERS = ("local", "slurm")
"""Where the runs of a command can be made: in processes of this machine, or as jobs of a cluster."""
