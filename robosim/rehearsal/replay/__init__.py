"""What the real arm recorded of a motion, played in the rehearsal beside the planned one.

Imports: config, conversion, errors, reports, robot, scene.
"""
