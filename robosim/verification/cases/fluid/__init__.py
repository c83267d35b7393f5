"""Cases of fluids.

Imports: scene, verification, mpm.
"""
