"""Tuning of dosing controllers: pour curves that are measured, and numbers that are searched on training seeds.

Imports: base, config, dosing, envs, episode, tasks."""
