"""The rigid scene and its grains: composition, sensors, filling, settling, grasp, collision monitoring.

Imports: base, config, rendering, robot, shapes, mpm."""
