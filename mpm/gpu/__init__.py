"""The stepper of a GPU: the phases of a substep as parallel loops.

Imports: backend, boundaries, observers, scene, state, stepping."""
