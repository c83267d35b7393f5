"""Cases of the arm.

Imports: config, robot, scene, mpm."""
