"""Demonstrations: making them by gradient or by CMA-ES, reading, scoring and exporting them.

Imports: learning, robosim, mpm."""

METHODS = ("descent", "cmaes")
"""Searches for a demonstration: gradient descent through the field, or CMA-ES."""
TASKS = ("SpoonScoop", "SpoonTranslate", "SpoonPour", "ScoopScoop", "ScoopTranslate", "ScoopPour", "BottlePickPour",
         "ShovelMove")
"""Tasks of the figure of derivatives, in its order."""
