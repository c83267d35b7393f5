"""What the real arm recorded of a motion, played in the rehearsal beside the planned one.

Imports: base, config, conversion, reports, robot, scene.
"""
