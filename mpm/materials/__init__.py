"""Material laws: elasticity, plasticity, fluids, and the tensor functions that they are written with.

Imports: backend, errors."""
