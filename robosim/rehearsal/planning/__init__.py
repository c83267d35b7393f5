"""Plans of rehearsals: tool paths, grips and postures, joint motions, clearances.

Imports: config, errors, robot, scene, shapes, tasks, mpm.
"""
