"""Cases of fluids.

Imports: mpm.
"""
