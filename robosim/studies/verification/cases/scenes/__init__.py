"""Cases of whole scenes: rehearsals with the arm, and episodes of the environments.

Imports: config, envs, planning, rehearsal, tasks, mpm.
"""
