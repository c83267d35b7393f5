"""Commands that measure errors and run time.

Imports: benchmarks, config, envs, errors, tasks, verification, mpm.
"""
