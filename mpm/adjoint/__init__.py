"""Gradients of roll-outs: the adjoint of every part of a substep, written out, and the schedule that keeps it small.

In a name, `bar` is the derivative of the loss by the quantity named. Which nodes and grains are in contact, which
columns of nodes meet a wall and which side of a yield surface a strain is on is held fixed in the derivative.
"""
