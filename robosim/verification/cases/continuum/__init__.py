"""Cases of elastic continua.

Imports: scene, verification, mpm.
"""
