"""Sub-tasks: their files, fields, actions, rewards, observations and differentiable objectives.

Imports: config, errors, scene, shapes, mpm.
"""
