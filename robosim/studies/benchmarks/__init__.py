"""Speed: of the field, the coupling, kinematics, environments and rehearsals; cost of a scene by part.

Imports: base, config, envs, episode, planning, rehearsal, reports, tasks, mpm."""

FIELD_SIZES = (300, 2880, 50_000)
"""Grains of the field's benchmark: a spoonful, a container at 8 mm cells, a kitchen bed."""
FIELD_SCENES = ("sand", "sand_with_tool", "sand_with_shell", "fluid", "clay")
RESET_TASKS = ("SpoonPour", "ScoopScoop", "DoseSpoon", "ShovelMove")
"""Tasks whose resets are timed: grains in a tool, in a container, to a mass, and on the table."""
KINDS = ("alone", "arm", "vector")
"""One environment, one with the whole arm, several that share a field."""
