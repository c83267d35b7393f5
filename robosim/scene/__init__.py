"""The rigid scene and its grains: composition, sensors, filling, settling, grasp, collision monitoring.

Imports: config, errors, rendering, robot, shapes, mpm.
"""
