"""Cases of granular matter.

Imports: scene, verification, mpm.
"""
