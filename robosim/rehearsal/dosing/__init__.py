"""The dose of a rehearsal: the tool about its lip, the balance under the cup, and the controller in the loop.

Imports: base, config, dosing, instruments, robot, scene, shapes, mpm.
"""
