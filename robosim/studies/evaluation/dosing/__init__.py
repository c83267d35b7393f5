"""Dosing controllers as policies.

Imports: base, cell, config, dosing, envs, scene, shapes, tasks, mpm."""
