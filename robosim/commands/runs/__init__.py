"""Commands that simulate, and show what was simulated.

Imports: calibration, config, conversion, dosing, envs, errors, evaluation, recordings, rehearsal, rendering,
robustness, tuning, viewer, mpm.
"""
