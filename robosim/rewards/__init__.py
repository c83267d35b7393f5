"""Terms of a task's reward: small classes, chosen and weighted in the section `reward` of a task's file.

Imports: config, mpm."""

from robosim.rewards import dose, grains, tool  # noqa: F401  (makes their terms known)
