"""Cases of elastic continua.

Imports: mpm."""
