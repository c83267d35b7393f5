"""A graph network as surrogate of the field: its rollouts, model and training.

Imports: demonstrations, learning.
"""
