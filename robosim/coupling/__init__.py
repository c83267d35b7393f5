"""Two-way coupling of a MuJoCo scene and a granular field.

Imports: errors, recordings, scene, mpm.
"""
