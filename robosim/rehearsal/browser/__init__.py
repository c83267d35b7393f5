"""Rehearsals in a browser: followed while they run, planned, and edited.

Imports: config, errors, recordings, reports, robot, scene, viewer, mpm.
"""
