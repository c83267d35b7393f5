"""Cases of forces of sand on plates, walls, silos and spheres.

Imports: base, config, mpm."""
