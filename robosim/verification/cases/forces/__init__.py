"""Cases of forces of sand on plates, walls, silos and spheres.

Imports: config, coupling, errors, verification, mpm.
"""
