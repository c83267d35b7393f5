"""Rehearsals with errors of the robot's model: whether a result holds without a perfect one.

Imports: base, config, rehearsal, reports."""
