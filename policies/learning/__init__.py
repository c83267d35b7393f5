"""Building blocks of learning: presets, buffers, networks, observation scaling, SB3 learners.

Imports: nothing of the project.
"""
