"""Whole-arm rehearsals: plan, run, readings, metrics, plots and film.

Imports: config, conversion, coupling, envs, errors, evaluation, recordings, rendering, reports, robot, scene, shapes,
tasks, viewer, mpm.
"""

CAMERAS = ("overview", "close", "wrist", "follow")
"""Cameras of the film: of the work cell, and one that follows hand and tool."""
COLOURS = ("material", "awake")
"""What the colour of the film's grains can show: their material, or also which of them are awake."""
