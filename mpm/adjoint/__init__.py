"""The adjoint of every phase of a substep, in files named like the forward ones that they reverse.

`x_bar` is the adjoint of x: the derivative of the loss with respect to x. It is constant in the derivative which nodes
and particles are in contact, which columns of nodes meet a wall, and on which side of a yield surface a strain is.

Imports: backend, boundaries, geometry, materials, scene, state, transfers."""
