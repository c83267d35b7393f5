"""Methods of learning: what a method must offer, those beyond Stable-Baselines3's own, and `robosim train`.

Imports: demonstrations, dynamics, learning, runs, robosim, mpm."""
