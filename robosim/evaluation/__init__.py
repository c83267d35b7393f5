"""Scoring of policies: one task, many materials, and the bundled policies.

Imports: config, envs, errors, randomization, recordings, rehearsal, rendering, reports, robot, scene, senses,
shapes, tasks, viewer, mpm.
"""

POLICIES = ("zero", "random", "scripted", "learned")
"""Policies by name; any other is the path of a .npz file."""
NETWORK = "network"
"""The bundled policy that observes, of the sub-tasks that have one."""
SUITES = ("nominal", "wide", "materials")
"""Starts and materials that policies are scored from, see `robosim.evaluation.suites`."""
