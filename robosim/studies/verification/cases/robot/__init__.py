"""Cases of the arm.

Imports: config, robot, mpm.
"""
