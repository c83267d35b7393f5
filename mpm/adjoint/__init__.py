"""The adjoint of every phase of a substep, in files named like the forward ones that they reverse.

`x_bar` is the adjoint of x: the derivative of the loss by x. Which nodes and particles are in contact, which columns of
nodes meet a wall and which side of a yield surface a strain is on is fixed in the derivative.

Imports: backend, boundaries, geometry, materials, scene, state, stepping, transfers.
"""
