"""Scoring of policies: one task, many materials, and the bundled policies.

Imports: config, envs, errors, rendering, reports, tasks, mpm.
"""
