"""Cases of granular matter.

Imports: base, config, scene, mpm."""
