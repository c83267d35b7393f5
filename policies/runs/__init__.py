"""Training runs: folder, checkpoints, episodes, sweeps.

Imports: demonstrations, dynamics, learning, results.
"""
