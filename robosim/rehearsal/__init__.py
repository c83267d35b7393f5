"""Whole-arm rehearsals: plan, run, readings, metrics and plots.

Imports: base, cell, config, conversion, coupling, dosing, episode, planning, recordings, rendering, reports, robot,
scene, shapes, viewer, mpm."""

CAMERAS = ("overview", "close", "wrist")
"""Cameras of the work cell, for films."""
