"""Commands that simulate, and show what was simulated.

Imports: calibration, config, conversion, envs, errors, evaluation, recordings, rehearsal, rendering, robustness,
viewer, mpm.
"""
