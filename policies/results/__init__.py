"""Tables of runs, with published numbers for comparison.

Imports: learning, robosim, mpm."""
