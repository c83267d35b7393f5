"""Commands that simulate, and show what was simulated.

Imports: config, envs, errors, evaluation, rehearsal, viewer, mpm.
"""
