"""Plans of rehearsals: tool paths, grips and postures, joint motions, clearances.

Imports: base, config, robot, scene, shapes, tasks, mpm.
"""
