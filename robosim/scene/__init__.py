"""The rigid scene and its grains: composition, filling, settling, counting, clearance.

Imports: config, errors, shapes, mpm.
"""
