"""Tuning of dosing controllers: pour curves that are measured, and numbers that are searched on training seeds.

Imports: config, dosing, envs, errors, evaluation, reports, tasks, mpm.
"""
