"""Sub-tasks: their files, fields, actions, rewards, observations and differentiable objectives.

Imports: base, config, dosing, rewards, robot, scene, shapes, mpm."""
