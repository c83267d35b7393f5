"""Plans of rehearsals: tool paths, grips and postures, joint motions, clearances.

Imports: base, config, dosing, robot, scene, shapes, tasks, mpm."""
