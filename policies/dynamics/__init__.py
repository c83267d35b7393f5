"""A graph network as surrogate of the field: the rollouts that it learns from, its model and training.

Imports: demonstrations, learning, robosim, mpm."""
