"""What episodes draw at random: materials, places, fills, frictions, errors of the robot and of its sensors.

Imports: base, config, scene, tasks, mpm."""
