"""Sub-tasks: their files, fields, actions, rewards, observations and differentiable objectives.

Imports: config, dosing, errors, scene, shapes, mpm.
"""
