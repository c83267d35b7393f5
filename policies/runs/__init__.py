"""Training runs: the training itself, its folder, episodes and checkpoints; sweeps and pipelines of many runs.

Imports: demonstrations, dynamics, learners, learning, results, robosim, mpm."""
