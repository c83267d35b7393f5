"""Cases of granular matter.

Imports: errors, scene, verification, mpm.
"""
