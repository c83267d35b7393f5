"""Recordings of motions: what moved, how the grains lay and what was measured, for the viewer and for other tools.

Imports: base, config, rendering, mpm."""
