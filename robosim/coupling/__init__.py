"""Two-way coupling of a MuJoCo scene and a granular field.

Imports: base, recordings, robot, scene, mpm."""
