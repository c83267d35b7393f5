"""Demonstrations: generators by gradient and by search, replay, export.

Imports: learning.
"""

METHODS = ("descent", "cmaes")
"""How a demonstration is optimised: by gradients through the field, or by CMA-ES."""
RATE = 0.05
"""Step of the descent, in actions of -1 to 1."""
