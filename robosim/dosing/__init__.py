"""Dosing: controllers that pour a target mass from a tool onto a balance, and the numbers that they are run with.

Imports: base, config, mpm."""

CONTROLLERS = ("open_loop", "pi", "shaker")
"""Controllers by name, see `robosim.dosing.controllers.make_controller`."""
