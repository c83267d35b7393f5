"""Tool paths of rehearsals: through waypoints, or along the learned motions of sub-tasks.

Imports: config, errors, scene, tasks, mpm.
"""
