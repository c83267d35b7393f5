"""A robot and grains that are simulated together, step by step, under commands of the robot's joints.

Imports: base, coupling, robot, scene, mpm.
"""
