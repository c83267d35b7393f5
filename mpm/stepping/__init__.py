"""Time integration: the phases of a substep, strides, launches, threads, batches, collider paths.

Imports: backend, boundaries, errors, geometry, materials, motion, observers, scene, state, transfers."""
