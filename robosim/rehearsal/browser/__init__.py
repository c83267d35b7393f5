"""Rehearsals in a browser: followed while they run, planned, and edited.

Imports: base, config, recordings, scene, viewer.
"""
