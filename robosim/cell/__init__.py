"""A robot and grains that are simulated together, step by step, and what commands the robot's joints.

Imports: base, config, coupling, robot, scene, mpm."""
