"""Stiff and extreme cases: stable, refused or unstable.

Imports: config, coupling, errors, robot, scene, verification, mpm.
"""
