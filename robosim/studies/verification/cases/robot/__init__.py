"""Cases of the arm.

Imports: config, envs, episode, robot, scene, mpm."""
