"""What a run of learning is set up from: presets, task names, environments, episodes.

Imports: robosim, mpm."""
