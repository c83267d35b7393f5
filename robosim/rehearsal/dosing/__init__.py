"""The dose of a rehearsal: the tool about its lip, the balance under the cup, and the controller in the loop.

Imports: config, dosing, errors, instruments, robot, scene, shapes, mpm.
"""
