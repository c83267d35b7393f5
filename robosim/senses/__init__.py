"""Observations of a policy: terms that its user chooses, with the rate, latency, noise and dropout of real sensors.

Imports: base, config, dosing, rendering, robot, scene, shapes, tasks, mpm."""
