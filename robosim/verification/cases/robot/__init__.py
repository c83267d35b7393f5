"""Cases of the arm.

Imports: config, evaluation, robot, scene, verification, mpm.
"""
