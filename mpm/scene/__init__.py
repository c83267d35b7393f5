"""What a scene is made of, before anything is allocated: grid, bodies, colliders, walls, and their checks.

Imports: backend, errors, geometry, materials."""
