"""Commands that measure errors and run time.

Imports: base, envs, studies, tasks."""
