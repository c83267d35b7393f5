"""Cases of the arm.

Imports: config, robot, verification, mpm.
"""
