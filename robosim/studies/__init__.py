"""Studies: they use the simulator, and nothing in the simulator knows them.

Verification, calibration, tuning, robustness, benchmarks and evaluation.

Imports: nothing of the project."""
