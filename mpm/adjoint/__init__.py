"""The adjoint of every phase of a substep, in files named like the forward ones that they reverse.

In a name, `bar` is the derivative of the loss by the quantity named. Which nodes and particles are in contact, which
columns of nodes meet a wall and which side of a yield surface a strain is on is held fixed in the derivative.

Imports: backend, boundaries, materials, scene, state, stepping, transfers.
"""
