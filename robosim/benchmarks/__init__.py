"""Speed: of the field, the coupling, kinematics, environments and rehearsals; cost of a scene by part.

Imports: config, envs, errors, evaluation, rehearsal, reports, tasks, verification, mpm.
"""
