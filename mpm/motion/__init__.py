"""Motion of colliders: prescribed paths, and the twists and mobilities of those that contact moves.

Imports: backend, errors, geometry, materials, scene."""
