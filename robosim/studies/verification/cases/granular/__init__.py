"""Cases of granular matter.

Imports: base, scene, mpm."""
