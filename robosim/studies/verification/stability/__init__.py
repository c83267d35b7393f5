"""Stiff and extreme cases: stable, refused or unstable.

Imports: base, cell, coupling, robot, scene, mpm."""

AXES = ("E", "friction_angle_deg", "courant", "drop_height", "shell_thickness", "lone_grain", "degenerate",
        "mass_ratio", "host_step", "tool_speed", "arm_host_step", "payload", "arm_pose", "rest")
"""Axes of the matrix; the judges are in `field`, `coupled`, `arm` and `rest`."""
COMPARISONS = ("lagged_mass_ratio", "lagged_host_step")
"""Axes that compare couplings."""
SLEEPING_PREFIX = "sleeping_"
SLEEPING_AXES = tuple(SLEEPING_PREFIX + axis for axis in ("friction_angle_deg", "courant", "drop_height"))
"""Axes of the matrix with particles that sleep: those in whose scenes some come to rest away from colliders."""
