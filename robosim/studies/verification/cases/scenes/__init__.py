"""Cases of whole scenes: rehearsals with the arm, and episodes of the environments.

Imports: config, envs, episode, planning, rehearsal, tasks, mpm."""
