"""Scoring of policies: one task, many materials, and the bundled policies.

Imports: base, cell, config, dosing, envs, episode, planning, randomization, recordings, rehearsal, reports, rewards,
robot, scene, senses, shapes, tasks, viewer, mpm."""
