"""Speed: of the field, the coupling, kinematics, environments and rehearsals; cost of a scene by part.

Imports: base, config, envs, episode, planning, rehearsal, reports, tasks, mpm."""

FIELD_SIZES = (300, 2880, 50_000)
"""Grains of the field's benchmark: a spoonful, a container at 8 mm cells, a kitchen bed."""
FIELD_SCENES = ("sand", "sand_with_tool", "sand_with_shell", "fluid", "clay")
