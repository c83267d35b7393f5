"""Calibration: a material card from what a laboratory can measure, with intervals and a verdict.

Imports: base, config, reports, mpm."""
