"""Several environments of one scene in one launch: states in a bank, numbers of each in a table.

Imports: backend, errors, geometry, materials, motion, observers, scene, state, stepping."""
