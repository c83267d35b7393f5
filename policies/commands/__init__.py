"""Commands of the learning side.

Imports: demonstrations, dynamics, learning, methods, results, runs, robosim, mpm."""
