"""Whole-arm rehearsals: plan, run, readings, metrics, plots and film.

Imports: base, config, conversion, coupling, dosing, recordings, rendering, reports, robot, scene, shapes, viewer, mpm.
"""

CAMERAS = ("overview", "close", "wrist")
"""Cameras of the work cell, for the film."""
COLOURS = ("material", "awake")
"""What the colour of the film's grains can show: their material, or also which of them are awake."""
