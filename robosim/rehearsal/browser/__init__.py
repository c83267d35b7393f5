"""Rehearsals in a browser: followed while they run, planned, and edited.

Imports: base, config, planning, recordings, reports, scene, tasks, viewer."""
