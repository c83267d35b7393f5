"""Cases of fluids.

Imports: base, mpm."""
