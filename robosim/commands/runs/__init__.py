"""Commands that simulate, and show what was simulated.

Imports: config, conversion, envs, errors, evaluation, recordings, rehearsal, rendering, robustness, viewer, mpm.
"""
