"""Boundary conditions on grid velocities: walls, periodic sides, solids, shells, mobile colliders.

Imports: backend, geometry, motion, scene, state."""
