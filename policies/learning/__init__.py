"""What a run of learning is set up from: presets, task names, environments, episodes, files, worker processes.

Imports: robosim, mpm.
"""
