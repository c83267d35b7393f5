"""Readings of a state: arrays, diagnostics, samples and counters that run inside a launch.

Imports: backend, errors, geometry, materials, scene, state."""
