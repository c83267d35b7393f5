"""Whole-arm rehearsals: paths, bundled motions, the run, its recording, metrics and film.

Imports: config, coupling, envs, errors, evaluation, rendering, robot, scene, shapes, tasks, mpm.
"""

CAMERAS = ("overview", "close", "wrist")
"""Cameras of the work cell, for the film."""
